//! Sign-in page: a plain form.

use maud::{DOCTYPE, Markup, html};

use super::{Words, heading};

/// Makes the sign-in page, which does not show the name of the machine. `top` is the relative address of the web page,
/// `view` the page to show after signing in, and `trouble` the key of an error message.
pub(in crate::observe) fn login(
    words: &Words,
    top: &str,
    view: Option<&str>,
    trouble: Option<&'static str>,
) -> Markup {
    html! {
        (DOCTYPE)
        html lang=(words.language) {
            head {
                (heading(words.get("sign_in"), top))
                link rel="stylesheet" href={ (top) "page/login.css" };
            }
            body {
                main {
                    h1 { "isotherm" }
                    p { (words.get("sign_in_text")) }
                    @if let Some(trouble) = trouble { p .trouble role="alert" { (words.get(trouble)) } }
                    form method="post" action={ (top) "login" } {
                        // User name under which a password manager stores the token.
                        input type="hidden" name="username" value="isotherm" autocomplete="username";
                        @if let Some(view) = view { input type="hidden" name="view" value=(view); }
                        label { (words.get("token")) " " input type="password" name="token" required autofocus autocomplete="current-password"; }
                        button type="submit" { (words.get("sign_in")) }
                    }
                }
            }
        }
    }
}
