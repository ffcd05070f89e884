//! Access rules of the web page, from the profile.

use isotherm_profile::{Commands, IpNetwork, Web};

use super::tokens::TokenFile;

/// Tokens, names and settings that determine which clients may view and command.
#[derive(Debug, Default)]
pub struct Admission {
    /// Token for reading the metrics only.
    pub scraper: Option<TokenFile>,
    /// Token for reading page, API and metrics.
    pub viewer: Option<TokenFile>,
    /// Token for reading and for commands.
    pub operator: Option<TokenFile>,
    /// Whether clients on this computer may command without a token.
    pub commands: Commands,
    /// Host names of the web page, in addition to `localhost` and IP addresses.
    pub hosts: Vec<String>,
    /// Proxies that report the client of a request.
    pub trusted_proxies: Vec<IpNetwork>,
}

impl Admission {
    /// Reads the access rules of a profile, and the token files.
    ///
    /// # Errors
    /// A token file cannot be used. The error is a sentence with the file and a remedy.
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
        let (commands, hosts, trusted_proxies) =
            (web.commands, web.hosts.clone(), web.trusted_proxies.clone());
        Ok(Admission { scraper, viewer, operator, commands, hosts, trusted_proxies })
    }
}
