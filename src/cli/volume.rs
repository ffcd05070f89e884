//! Check whether the saved state of a gateway in a container is lost when the container is removed.

use std::path::Path;

/// Returns a description of the storage that contains this directory, if this storage is lost when the container is
/// removed. Returns `None` if the storage is kept, as far as the kernel's mounts show.
pub(super) fn volatile_mount(directory: &Path) -> Option<&'static str> {
    let mounts = std::fs::read_to_string("/proc/self/mountinfo").ok()?;
    lost_with(&mounts, &directory.canonicalize().ok()?)
}

/// Searches the kernel's list of mounts for the storage that contains this directory. Returns a description of the
/// storage if it is lost with the container, and `None` otherwise. If several mounts have one path, only the last one
/// is visible.
fn lost_with(mounts: &str, directory: &Path) -> Option<&'static str> {
    let mount = (mounts.lines().filter_map(Mount::of))
        .filter(|mount| directory.starts_with(mount.at))
        .max_by_key(|mount| mount.at.components().count())?;
    let parts: Vec<&str> = mount.lies_in.split('/').collect();
    // The name of a removable directory is a number as long as a SHA-256. containerd is detected by the path of its
    // layers.
    let is_number = |part: &str| part.len() == 64 && part.bytes().all(|byte| byte.is_ascii_hexdigit());
    match parts.iter().position(|part| is_number(part)) {
        Some(place) if place > 0 && parts[place - 1] == "volumes" => {
            Some("an anonymous volume, which the next container does not use")
        }
        Some(_) => Some(LAYER),
        None if parts.iter().any(|part| part.starts_with("io.containerd.snapshotter")) => Some(LAYER),
        None => None,
    }
}

const LAYER: &str = "the writable layer of this container, which is lost when the container is replaced";

/// One line of /proc/self/mountinfo (proc_pid_mountinfo(5)).
struct Mount<'line> {
    at: &'line Path,
    /// Directory of the host that is mounted; for an overlay file system, its writable directory.
    lies_in: &'line str,
}

impl Mount<'_> {
    fn of(line: &str) -> Option<Mount<'_>> {
        let (seen, file_system) = line.split_once(" - ")?;
        let mut seen = seen.split(' ').skip(3);
        let (root, at) = (seen.next()?, Path::new(seen.next()?));
        let options = file_system.split(' ').nth(2)?;
        let upper = options.split(',').find_map(|option| option.strip_prefix("upperdir="));
        Some(Mount { at, lies_in: upper.unwrap_or(root) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ROOT: &str = "126 60 0:51 / / ro - overlay overlay rw,lowerdir=/var/lib/docker/overlay2/l/A,upperdir=/var/lib/docker/overlay2/";

    #[test]
    fn a_state_that_goes_with_its_container_is_known_by_where_the_host_keeps_it() {
        let number = "0123456789abcdef".repeat(4);
        let layer = format!("{ROOT}{number}/diff,workdir=/w");
        let at = |root: &str| {
            format!("{layer}\n151 126 254:0 {root} /var/lib/isotherm rw,nosuid master:1 - ext4 /dev/vda rw")
        };
        for (mounts, lost) in [
            (layer.clone(), Some("layer")),
            (at(&format!("/var/lib/docker/volumes/{number}/_data")), Some("anonymous volume")),
            (at(&format!("/volumes/{number}/_data")), Some("anonymous volume")),
            (at("/var/lib/docker/volumes/isotherm_state/_data"), None),
            (at("/var/lib/containers/storage/volumes/state/_data"), None),
            (at("/srv/isotherm"), None),
            (at(&format!("/var/lib/containers/storage/vfs/dir/{number}/state")), Some("layer")),
            (format!("{}\n9 1 0:9 / /var/lib/isotherm rw - tmpfs tmpfs rw", at(&format!("/volumes/{number}"))), None),
            (
                "1 0 0:1 / / rw - overlay overlay rw,upperdir=/var/lib/containerd/io.containerd.snapshotter.v1.overlayfs/\
                 snapshots/7/fs,workdir=/w"
                    .to_owned(),
                Some("layer"),
            ),
            ("1 0 254:0 / / rw - ext4 /dev/vda rw".to_owned(), None),
            // A computer that boots from an overlay, without a container.
            ("1 0 0:1 / / rw - overlay overlayfs:/overlay rw,upperdir=/overlay/upper,workdir=/w".to_owned(), None),
            (String::new(), None),
        ] {
            let found = lost_with(&mounts, Path::new("/var/lib/isotherm"));
            assert_eq!(found.is_some(), lost.is_some(), "{found:?}: {mounts}");
            assert!(found.zip(lost).is_none_or(|(found, word)| found.contains(word)), "{found:?}: {mounts}");
        }
    }
}
