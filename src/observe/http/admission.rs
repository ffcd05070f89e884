//! What the profile says of who may come in.

use isotherm_profile::{Commands, Web};

use super::tokens::TokenFile;

/// Who may look and who may command.
#[derive(Debug, Default)]
pub struct Admission {
    /// Of those who collect the metrics, and see nothing else.
    pub scraper: Option<TokenFile>,
    /// Of those who look.
    pub viewer: Option<TokenFile>,
    /// Of those who command.
    pub operator: Option<TokenFile>,
    /// Whether everybody on this computer may command too.
    pub commands: Commands,
    /// Names of the page, besides localhost and its addresses.
    pub hosts: Vec<String>,
}

impl Admission {
    /// What a profile says, its token files read.
    ///
    /// # Errors
    /// A sentence with a token file and what to do.
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
                    "the {whose} token is the {of_whom}: make another one with isotherm token"
                ));
            }
        }
        let (commands, hosts) = (web.commands, web.hosts.clone());
        Ok(Admission { scraper, viewer, operator, commands, hosts })
    }

    /// Somebody on another computer can be told from the others.
    pub fn has_token(&self) -> bool {
        [&self.scraper, &self.viewer, &self.operator].into_iter().any(Option::is_some)
    }
}
