//! Servers that receive notifications (`[[notify]]` of the profile): trusted certificates, checks of the files that the
//! profile names for them, and test connections.

use std::sync::Arc;
use std::time::Duration;

use super::connection_test::ConnectionTest;
use crate::fieldbus::tls;
use crate::observe::notify::{Server, Trust, read_token};
use isotherm_profile::{Notify, Profile};

/// Time limit of a test connection.
const WITHIN: Duration = Duration::from_secs(10);

/// Returns the TLS settings that verify a server's certificate, or an error. They trust the authorities in the file
/// `ca` of the profile, otherwise those of this computer.
pub(super) fn trust(notify: &Notify) -> Trust {
    tls::plant_client(notify.ca.as_ref().map(|ca| ca.bytes.as_slice())).map(Arc::new)
}

/// Returns the token files and certificates that cannot be used, each with the reason. Empty if all these files
/// are usable.
pub(super) fn hindered(profile: &Profile) -> Vec<String> {
    let of = |notify: &Notify| {
        let token = notify.token_file.as_ref().and_then(|path| read_token(path).err());
        let trust = notify.url.tls.then(|| trust(notify).err()).flatten();
        let said = token.into_iter().chain(trust);
        said.map(|why| format!("{}: {why}. The gateway posts no message without this file", notify.name))
            .collect::<Vec<_>>()
    };
    profile.notify.iter().flat_map(of).collect()
}

/// Connects to all notification servers at the same time, including the TLS handshake, and sends no message. Returns
/// one result for each server.
pub(super) fn look(profile: &Profile) -> anyhow::Result<Vec<ConnectionTest>> {
    if profile.notify.is_empty() {
        return Ok(Vec::new());
    }
    let runtime = super::runtime::start()?;
    let looked = runtime.block_on(async {
        let look = |notify: &Notify| {
            let server = Server::of(notify, trust(notify));
            tokio::spawn(async move { server.reached(WITHIN).await })
        };
        let looks: Vec<_> = profile.notify.iter().map(|notify| (notify, look(notify))).collect();
        let mut looked = Vec::new();
        for (notify, look) in looks {
            let fault = look.await?.err().map(|fault| fault.to_string());
            let well = "is reachable; no message was posted";
            looked.push(ConnectionTest::at(&notify.name, notify.url.to_string(), well, fault));
        }
        anyhow::Ok(looked)
    });
    // A name lookup that has not ended must not delay the end.
    runtime.shutdown_background();
    looked
}
