//! Sign-in page: a plain form that works without scripts.

use maud::{DOCTYPE, Markup, html};

use super::{Words, heading};

/// Machine name and page address that a sign-in page needs.
#[derive(Clone, Copy)]
pub(in crate::observe) struct LoginPlace<'a> {
    /// Displayed name of the machine.
    pub(in crate::observe) machine: &'a str,
    /// Relative address of the web page, for example `../`.
    pub(in crate::observe) top: &'a str,
}

/// Makes a sign-in page. `parameters` belong to the address that the browser shows after the sign-in.
/// `trouble` is the key of an error message.
pub(in crate::observe) fn login(
    words: &Words,
    LoginPlace { machine, top }: LoginPlace<'_>,
    parameters: &[(&'static str, String)],
    trouble: Option<&'static str>,
) -> Markup {
    html! {
        (DOCTYPE)
        html lang=(words.language) {
            head {
                (heading(machine, top))
                link rel="stylesheet" href={ (top) "page/login.css" };
            }
            body {
                main {
                    p .program { "isotherm" }
                    h1 { (machine) }
                    p { (words.get("sign_in_text")) }
                    @if let Some(trouble) = trouble { p .trouble role="alert" { (words.get(trouble)) } }
                    form method="post" action={ (top) "login" } {
                        // User name under which a password manager stores the token.
                        input type="hidden" name="username" value="isotherm" autocomplete="username";
                        @for (name, value) in parameters { input type="hidden" name=(name) value=(value); }
                        label { (words.get("token")) " " input type="password" name="token" required autofocus autocomplete="current-password"; }
                        button type="submit" { (words.get("sign_in")) }
                    }
                }
            }
        }
    }
}
