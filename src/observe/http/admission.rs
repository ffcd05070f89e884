//! What the profile says of who may come in.

use isotherm_profile::{Commands, Web};

use super::tokens::TokenFile;

/// Who may look and who may command.
#[derive(Debug, Default)]
pub struct Admission {
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
        let (viewer, operator) = (read(&web.viewer_token_file)?, read(&web.token_file)?);
        if viewer
            .as_ref()
            .zip(operator.as_ref())
            .is_some_and(|(viewer, operator)| viewer.is_same_as(operator))
        {
            return Err(
                "the viewer's token is the operator's: make another one with isotherm token".to_owned()
            );
        }
        let (commands, hosts) = (web.commands, web.hosts.clone());
        Ok(Admission { viewer, operator, commands, hosts })
    }

    /// Somebody on another computer can be told from the others.
    pub fn has_token(&self) -> bool {
        self.viewer.is_some() || self.operator.is_some()
    }
}
