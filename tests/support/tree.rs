//! Files as the kernel shows them below /sys.

use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::process::Command;

use tempfile::TempDir;

pub(crate) const PROBE: &str = "28-0316a2794f01";

/// Directory with the structure of /sys.
pub(crate) struct Tree(TempDir);

impl Tree {
    pub(crate) fn new() -> Tree {
        Tree(tempfile::tempdir().unwrap())
    }

    pub(crate) fn root(&self) -> &Path {
        self.0.path()
    }

    /// Writes a file in the directory.
    pub(crate) fn put(&self, name: &str, text: &str) {
        let path = self.0.path().join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, text).unwrap();
    }

    /// Adds a hwmon chip with this number and name, which belongs to this device.
    pub(crate) fn hwmon(&self, number: u32, name: &str, device: &str, files: &[(&str, &str)]) {
        let home = format!("devices/{device}/hwmon/hwmon{number}");
        self.put(&format!("{home}/name"), &format!("{name}\n"));
        files.iter().for_each(|(file, text)| self.put(&format!("{home}/{file}"), &format!("{text}\n")));
        let home = self.root().join(home);
        symlink(home.join("../.."), home.join("device")).unwrap();
        self.lists("class/hwmon", &home);
    }

    /// Adds an IIO device with this number and name, which belongs to this device.
    pub(crate) fn iio(&self, number: u32, name: &str, device: &str, files: &[(&str, &str)]) {
        let home = format!("devices/{device}/iio:device{number}");
        self.put(&format!("{home}/name"), &format!("{name}\n"));
        files.iter().for_each(|(file, text)| self.put(&format!("{home}/{file}"), &format!("{text}\n")));
        self.lists("bus/iio/devices", &self.root().join(home));
    }

    fn lists(&self, class: &str, home: &Path) {
        let class = self.root().join(class);
        std::fs::create_dir_all(&class).unwrap();
        symlink(home, class.join(home.file_name().unwrap())).unwrap();
    }

    /// Path of the file of a 1-Wire sensor.
    pub(crate) fn one_wire(id: &str) -> String {
        format!("bus/w1/devices/{id}/w1_slave")
    }

    /// Sets the value of a 1-Wire sensor, in m°C.
    pub(crate) fn measures(&self, id: &str, milli: i32) {
        self.put(&Tree::one_wire(id), &pad(milli));
    }

    /// Creates a file that hangs, like one whose driver waits forever.
    pub(crate) fn hangs(&self, name: &str) -> PathBuf {
        let path = self.0.path().join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        assert!(Command::new("mkfifo").arg(&path).status().unwrap().success());
        path
    }
}

/// Text that the driver of a 1-Wire sensor shows.
pub(crate) fn pad(milli: i32) -> String {
    let bytes = "72 01 4b 46 7f ff 0e 10 57";
    format!("{bytes} : crc=57 YES\n{bytes} t={milli}\n")
}
