//! Users of this computer: the user of a connection, and the owner of a socket.

use std::os::unix::fs::MetadataExt;
use std::path::Path;

use isotherm_profile::{one_line, safe_file};
use tokio::net::UnixStream;

use super::sockets::listening;

const USERS: &str = "/etc/passwd";
const GROUPS: &str = "/etc/group";

/// Returns name and uid of the user at the other end of the connection.
pub(super) fn name(stream: &UnixStream) -> String {
    let Ok(peer) = stream.peer_cred() else { return "somebody".to_owned() };
    let uid = peer.uid();
    match named(USERS, uid) {
        Some(name) => format!("{name} (uid {uid})"),
        None => format!("uid {uid}"),
    }
}

/// Explains why this user may not connect to the socket. The text names the owner and the group of the socket or of its
/// directory, if they are visible.
pub fn forbidden(path: &Path) -> String {
    let seen = path.ancestors().find_map(|place| std::fs::metadata(place).ok());
    let who = seen.map_or_else(String::new, |seen| {
        let (uid, gid) = (seen.uid(), seen.gid());
        let user = named(USERS, uid).unwrap_or_else(|| uid.to_string());
        let group = named(GROUPS, gid).unwrap_or_else(|| gid.to_string());
        format!(": run this as user {user}, or as a member of group {group}")
    });
    let absolute = std::path::absolute(path).unwrap_or_default();
    let machine = path.file_stem().unwrap_or_default().to_string_lossy();
    match listening(&machine).contains(&absolute) {
        true => format!("the gateway runs, but you may not command it ({}){who}", path.display()),
        false => format!("{}: you may not access this path{who}", path.display()),
    }
}

/// Finds the name of the user or group with this number in a file, for example `/etc/passwd`. Returns `None` if the
/// file does not contain the number.
fn named(list: &str, number: u32) -> Option<String> {
    let list = safe_file::read_text(Path::new(list)).ok()?;
    found(&list, number).map(|name| one_line(name).into_owned())
}

/// Finds the name of the user or group with this number. `list` consists of lines of the form `name:x:1000:…`.
fn found(list: &str, number: u32) -> Option<&str> {
    list.lines().find_map(|line| {
        let mut fields = line.split(':');
        let (name, own) = (fields.next()?, fields.nth(1)?);
        (own.parse() == Ok(number)).then_some(name)
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
