//! Identity of a serial port. The identity shows whether a newly opened port is the port that was open before.
//!
//! The name and the device number do not identify a port: another adapter may get both after the first adapter was
//! unplugged. The kernel registers each adapter that is plugged in. It creates a directory in sysfs and a node in
//! devtmpfs, each with a new inode. The directory also identifies an adapter whose node was created manually, as in a
//! container.
//!
//! A pseudo-terminal is not registered, and its node has the same inode whenever its number is used again. The `ctime`
//! of the node is the time of its creation. Reading and writing change only the other two times of the node
//! (`tty_update_time` in the kernel).

use std::fs::{self, File, Metadata};
use std::os::unix::fs::{FileTypeExt, MetadataExt};

/// Returns the name of a serial port that all of its paths share: its device number. If there is no such port, returns
/// its path.
pub(in crate::fieldbus) fn place(path: &str) -> String {
    match fs::metadata(path).ok().and_then(|found| device_number(&found)) {
        Some(number) => format!("serial {number:x}"),
        None => format!("serial {}", std::path::absolute(path).unwrap_or_default().display()),
    }
}

/// Returns the device number of a serial port, which all of its paths share; `None` if the file is not a character
/// device.
fn device_number(found: &Metadata) -> Option<u64> {
    found.file_type().is_char_device().then(|| found.rdev())
}

/// Identity of an opened serial port. Equal identities mean the same port.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PortIdentity {
    device_number: u64,
    /// Numbers of the file system and of the inode of the device node.
    node: (u64, u64),
    origin: Origin,
}

/// Number that changes each time the kernel creates the port: when an adapter is plugged in, or for a new
/// pseudo-terminal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Origin {
    /// Inode of the sysfs directory of a registered device.
    Registration(u64),
    /// `ctime` of the device node in seconds and nanoseconds, used if no registration was found.
    NodeChange(i64, i64),
}

impl PortIdentity {
    /// Returns the identity of an open port; `None` if the file is not a character device.
    pub(super) fn of(port: &File) -> Option<PortIdentity> {
        let node = port.metadata().ok()?;
        let device_number = device_number(&node)?;
        let origin = registration(device_number)
            .map_or(Origin::NodeChange(node.ctime(), node.ctime_nsec()), Origin::Registration);
        Some(PortIdentity { device_number, node: (node.dev(), node.ino()), origin })
    }
}

/// Returns the inode of a character device's directory in sysfs; `None` if the device is not registered.
fn registration(device_number: u64) -> Option<u64> {
    let (major, minor) = (rustix::fs::major(device_number), rustix::fs::minor(device_number));
    fs::metadata(format!("/sys/dev/char/{major}:{minor}")).ok().map(|directory| directory.ino())
}

/// Result of the last attempt to open the port, compared with the attempt before.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum PortHistory {
    /// No port is known: none was opened yet, or the last attempt failed.
    #[default]
    None,
    /// The last attempt opened the same port as the attempt before, or the attempt before opened none.
    Same(PortIdentity),
    /// The last attempt opened another port than the attempt before.
    Other(PortIdentity),
}

impl PortHistory {
    /// Returns the history after another attempt to open the port. `opened` is the identity of the port; `None` if the
    /// attempt failed. The line itself reports a failed attempt as a lost contact. The previous port is then forgotten,
    /// so that the next port is not reported as a second loss of contact.
    #[must_use]
    pub(crate) fn and(self, opened: Option<PortIdentity>) -> PortHistory {
        match (self, opened) {
            (_, None) => PortHistory::None,
            (PortHistory::Same(before) | PortHistory::Other(before), Some(port)) if before != port => {
                PortHistory::Other(port)
            }
            (_, Some(port)) => PortHistory::Same(port),
        }
    }

    /// Returns false if the last attempt opened another port than the attempt before.
    pub(crate) fn resumes(self) -> bool {
        !matches!(self, PortHistory::Other(_))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PORT: PortIdentity =
        PortIdentity { device_number: 0xbc00, node: (5, 900), origin: Origin::Registration(51_000) };

    #[test]
    fn a_port_resumes_unless_it_is_another_one_than_the_last_that_was_opened() {
        let plugged_in_again = PortIdentity { origin: Origin::Registration(51_700), ..PORT };
        let table: [(&[Option<PortIdentity>], bool); 7] = [
            (&[Some(PORT)], true),
            (&[Some(PORT), Some(PORT)], true),
            (&[Some(PORT), Some(plugged_in_again)], false),
            (&[Some(PORT), Some(plugged_in_again), Some(plugged_in_again)], true),
            (&[Some(PORT), Some(plugged_in_again), Some(PORT)], false),
            // The failed attempt was reported.
            (&[Some(PORT), None, Some(plugged_in_again)], true),
            (&[None, Some(PORT)], true),
        ];
        for (attempts, resumes) in table {
            let history = attempts.iter().fold(PortHistory::default(), |history, port| history.and(*port));
            assert_eq!(history.resumes(), resumes, "{attempts:?}");
        }
    }

    #[test]
    fn each_part_of_the_identity_distinguishes_two_ports() {
        let others = [
            PortIdentity { device_number: 0xbc01, ..PORT },
            PortIdentity { node: (6, 900), ..PORT },
            PortIdentity { node: (5, 901), ..PORT },
            PortIdentity { origin: Origin::Registration(51_001), ..PORT },
            PortIdentity { origin: Origin::NodeChange(51_000, 0), ..PORT },
        ];
        for other in others {
            assert_eq!(PortHistory::Same(PORT).and(Some(other)), PortHistory::Other(other), "{other:?}");
        }
    }

    #[test]
    fn a_device_is_the_same_each_time_it_is_opened_and_a_file_has_no_identity() {
        let identity = |path: &str| PortIdentity::of(&File::open(path).unwrap());
        assert!(identity("/dev/null").is_some());
        assert_eq!(identity("/dev/null"), identity("/dev/null"));
        assert_ne!(identity("/dev/null"), identity("/dev/zero"));
        let file = tempfile::NamedTempFile::new().unwrap();
        assert_eq!(identity(file.path().to_str().unwrap()), None);
    }

    #[test]
    fn a_serial_port_and_a_link_to_it_are_one_name() {
        let home = tempfile::tempdir().unwrap();
        let link = home.path().join("by-id");
        std::os::unix::fs::symlink("/dev/null", &link).unwrap();
        assert_eq!(place("/dev/null"), place(link.to_str().unwrap()));
        assert_ne!(place("/dev/null"), place("/dev/zero"));
        assert_eq!(place("/dev/ttyNONE"), "serial /dev/ttyNONE");
    }
}
