//! Who is at the other end of the socket.

use std::path::Path;

use isotherm_profile::regular;
use tokio::net::UnixStream;

/// The name of a user, and his number.
pub(super) fn name(stream: &UnixStream) -> String {
    let Ok(peer) = stream.peer_cred() else { return "somebody".to_owned() };
    let uid = peer.uid();
    let users = regular::read_text(Path::new("/etc/passwd")).unwrap_or_default();
    match found(&users, uid) {
        Some(name) => format!("{name} (uid {uid})"),
        None => format!("uid {uid}"),
    }
}

/// The user of this number, in the lines `name:x:1000:…`.
fn found(users: &str, uid: u32) -> Option<&str> {
    users.lines().find_map(|line| {
        let mut fields = line.split(':');
        let (name, number) = (fields.next()?, fields.nth(1)?);
        (number.parse() == Ok(uid)).then_some(name)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_user_is_found_by_his_number() {
        let users = "root:x:0:0:root:/root:/bin/sh\nbroken\noperator:x:1000:100::/home/operator:/bin/sh\n";
        assert_eq!(found(users, 1000), Some("operator"));
        assert_eq!((found(users, 0), found(users, 7)), (Some("root"), None));
    }
}
