//! Paths of command sockets, and which of them accept connections. The kernel lists its sockets for every user.

use std::path::{Path, PathBuf};

/// Flag in the kernel's list of sockets: the socket accepts connections.
const ACCEPTS: u32 = 0x1_0000;

/// Returns the path of the command socket of a machine.
pub fn path(directory: &Path, machine: &str) -> PathBuf {
    directory.join(format!("{machine}.sock"))
}

/// Returns the paths of the command sockets at which gateways of the machine with this name accept connections.
pub fn listening(machine: &str) -> Vec<PathBuf> {
    let list = std::fs::read_to_string("/proc/net/unix").unwrap_or_default();
    found(&list, machine)
}

/// Finds the command sockets of a machine in the kernel's list, by their file names. Only sockets that accept
/// connections are returned. A line of the list is `address: references protocol flags type state inode path`.
fn found(list: &str, machine: &str) -> Vec<PathBuf> {
    let name = path(Path::new(""), machine);
    let socket = |line: &str| {
        let mut fields = line.splitn(8, ' ');
        let flags = u32::from_str_radix(fields.nth(3)?, 16).ok()?;
        // The inode is padded with blanks.
        let path = Path::new(&line[line.find(" /")? + 1..]);
        (flags & ACCEPTS != 0 && path.file_name() == Some(name.as_os_str())).then(|| path.to_owned())
    };
    let mut found: Vec<PathBuf> = list.lines().skip(1).filter_map(socket).collect();
    found.sort();
    found.dedup();
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sockets_of_a_machine_that_listen_are_found_in_the_kernel_s_list() {
        let list = "Num       RefCount Protocol Flags    Type St Inode Path\n\
                    00000000c5ab98bd: 00000003 00000000 00000000 0001 03 4371428\n\
                    0000000092c9f7d1: 00000002 00000000 00010000 0001 01    21 /srv/a b/press.sock\n\
                    0000000092c9f7d2: 00000003 00000000 00000000 0001 03 4371 /srv/a b/press.sock\n\
                    0000000092c9f7d3: 00000002 00000000 00010000 0001 01 437100 /srv/other/press-7.sock\n\
                    0000000092c9f7d4: 00000002 00000000 00010000 0001 01 437101 @/abstract/press.sock\n\
                    0000000092c9f7d5: 00000002 00000000 00010000 0001 01 437102 press.sock\n\
                    0000000092c9f7d6: 00000002 00000000 00010000 0001 01 437103 /run/press.sock\n";
        assert_eq!(
            found(list, "press"),
            [PathBuf::from("/run/press.sock"), PathBuf::from("/srv/a b/press.sock")]
        );
        assert!(found("", "press").is_empty());
    }
}
