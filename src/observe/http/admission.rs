//! Admission rules of the web page, from the profile.

use isotherm_profile::{Commands, Web};

use super::tokens::TokenFile;

/// Tokens and names by which clients may view and command.
#[derive(Debug, Default)]
pub struct Admission {
    /// Token for scraping the metrics, and nothing else.
    pub scraper: Option<TokenFile>,
    /// Token for viewing page, API and metrics.
    pub viewer: Option<TokenFile>,
    /// Token for viewing and for commands.
    pub operator: Option<TokenFile>,
    /// Whether every client on this computer may also command.
    pub commands: Commands,
    /// Names of the page, in addition to localhost and its addresses.
    pub hosts: Vec<String>,
}

impl Admission {
    /// Reads the admission rules of a profile, with the token files.
    ///
    /// # Errors
    /// A sentence with a token file and a remedy.
    pub fn of(web: &Web) -> Result<Admission, String> {
        let read = |path: &Option<_>| path.as_deref().map(TokenFile::read).transpose();
        let scraper = read(&web.scrape_token_file)?;
        let (viewer, operator) = (read(&web.viewer_token_file)?, read(&web.token_file)?);
        for (one, whose, other, of_whom) in [
            (&viewer, "viewer's", &operator, "operator's"),
            (&scraper, "scraper's", &operator, "operator's"),
            (&scraper, "scraper's", &viewer, "viewer's"),
        ] {
            if one.as_ref().zip(other.as_ref()).is_some_and(|(one, other)| one.is_same_as(other)) {
                return Err(format!(
                    "the {whose} token is the same as the {of_whom} token: make another one with isotherm \
                     token"
                ));
            }
        }
        let (commands, hosts) = (web.commands, web.hosts.clone());
        Ok(Admission { scraper, viewer, operator, commands, hosts })
    }

    /// Returns true if the profile has any token. Without one, clients on other computers cannot be authenticated.
    pub fn has_token(&self) -> bool {
        [&self.scraper, &self.viewer, &self.operator].into_iter().any(Option::is_some)
    }
}
