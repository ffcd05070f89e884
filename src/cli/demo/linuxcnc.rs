//! LinuxCNC as the machine control (CNC) of the demo. It runs without a screen from the files of `profiles/linuxcnc`,
//! and cuts a part repeatedly.

use std::hash::{BuildHasher, Hasher, RandomState};
use std::io::{BufRead, BufReader, Write};
use std::net::TcpListener;
use std::os::unix::fs::{DirBuilderExt, PermissionsExt};
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::time::Duration;

use anyhow::Context;

use crate::virtual_machine::Window;
use isotherm_profile::{AxisId, Profile};

/// Shipped machine whose control is LinuxCNC.
pub(super) const MACHINE: &str = "linuxcnc-mill";

/// Name of the bus in the profile at which the isotherm component of LinuxCNC listens.
const BUS: &str = "control";

/// Interval at which the virtual plant (simulated machine) gets the offset that LinuxCNC applies.
const LOOKS: Duration = Duration::from_millis(10);

macro_rules! files {
    ($($name:literal),* $(,)?) => {
        [$(($name, include_str!(concat!("../../../profiles/linuxcnc/", $name)))),*]
    };
}

/// Files with which LinuxCNC is started. The first [`PROGRAMS`] files are executable programs.
const FILES: [(&str, &str); 15] = files![
    "headless",
    "isotherm-eoffset",
    "isotherm.hal",
    "isotherm_eoffset/__init__.py",
    "isotherm_eoffset/control.py",
    "isotherm_eoffset/gate.py",
    "isotherm_eoffset/modbus.py",
    "sim/commands.py",
    "sim/mill.hal",
    "sim/mill.ini",
    "sim/mill.nml",
    "sim/mill.tbl",
    "sim/mill.var",
    "sim/part.ngc",
    "sim/simulation.py",
];

/// Number of programs at the start of [`FILES`].
const PROGRAMS: usize = 2;

/// Name of the file for the standard error of LinuxCNC.
const LOG: &str = "linuxcnc.log";

/// Running LinuxCNC with the isotherm component. Dropping it ends LinuxCNC.
#[derive(Debug)]
pub(super) struct Mill {
    child: Child,
    directory: PathBuf,
    port: u16,
    talk: Option<(ChildStdin, BufReader<ChildStdout>)>,
}

impl Mill {
    /// Starts LinuxCNC if it is the control of this machine. Returns `None` for other machines.
    pub(super) fn of(machine: &str) -> anyhow::Result<Option<Mill>> {
        if machine != MACHINE {
            return Ok(None);
        }
        let is_there = std::env::var_os("PATH")
            .is_some_and(|path| std::env::split_paths(&path).any(|folder| folder.join("linuxcnc").exists()));
        anyhow::ensure!(
            is_there,
            "{MACHINE} needs LinuxCNC, which is not installed here. On Debian, as root: apt-get install \
             --no-install-recommends linuxcnc-uspace python3-pymodbus python3-serial-asyncio. Every other \
             machine runs without LinuxCNC"
        );
        Mill::start().map(Some)
    }

    fn start() -> anyhow::Result<Mill> {
        let number = RandomState::new().build_hasher().finish();
        let directory = std::env::temp_dir().join(format!("isotherm-linuxcnc-{number:016x}"));
        write_files(&directory).with_context(|| format!("{} cannot be written", directory.display()))?;
        // A port that is free now is given to the component, because it does not report a port that it chose itself.
        let port = TcpListener::bind("127.0.0.1:0")?.local_addr()?.port();
        let mut command = Command::new(directory.join("headless"));
        command.args(["--home", "--port", &port.to_string(), "--run"]).arg(directory.join("sim/part.ngc"));
        let log = std::fs::File::create(directory.join(LOG))?;
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(log);
        // Ctrl-C ends the demo, but LinuxCNC must run until the gateway has removed its offset.
        command.process_group(0);
        let mut child = command.spawn().with_context(|| format!("{command:?} cannot be started"))?;
        let talk = child.stdin.take().zip(child.stdout.take().map(BufReader::new));
        let mut mill = Mill { child, directory, port, talk };
        let (_, says) = mill.talk.as_mut().context("LinuxCNC has no output")?;
        let mut line = String::new();
        while line.trim() != "ready" {
            line.clear();
            if says.read_line(&mut line)? == 0 {
                anyhow::bail!("LinuxCNC did not start: {}", mill.complaint());
            }
        }
        Ok(mill)
    }

    /// Returns the last line of LinuxCNC's log, with a hint.
    fn complaint(&self) -> String {
        let log = std::fs::read_to_string(self.directory.join(LOG)).unwrap_or_default();
        let last =
            log.lines().rfind(|line| !line.trim().is_empty()).unwrap_or("the log of LinuxCNC is empty");
        format!(
            "{last}. Only one LinuxCNC can run on a computer at a time; it needs python3-pymodbus and \
             python3-serial-asyncio"
        )
    }

    /// Returns an error if LinuxCNC has ended before the demo.
    pub(super) fn has_run_through(&mut self) -> anyhow::Result<()> {
        match self.child.try_wait()? {
            None => Ok(()),
            Some(_) => Err(anyhow::anyhow!("LinuxCNC ended before the demo: {}", self.complaint())),
        }
    }

    /// Sets the address of the control in the profile to the address of LinuxCNC. A thread then moves the virtual plant
    /// by the offset that LinuxCNC applies.
    pub(super) fn takes_the_place_of_the_control(
        mut self,
        profile: &mut Profile,
        window: &Window,
    ) -> anyhow::Result<Mill> {
        for bus in profile.buses.iter_mut().filter(|bus| bus.name == BUS) {
            bus.address = format!("127.0.0.1:{}", self.port);
        }
        let (mut asks, mut says) = self.talk.take().context("LinuxCNC has no output")?;
        let axes: Vec<String> = profile.axes.iter().map(|axis| axis.settings.name.clone()).collect();
        let window = window.clone();
        std::thread::Builder::new().name("linuxcnc".to_owned()).spawn(move || {
            loop {
                for (place, axis) in axes.iter().enumerate() {
                    let Some(mm) = offset_mm(&mut asks, &mut says, axis) else { return };
                    window.applies_elsewhere(AxisId(place), 1000.0 * mm);
                }
                std::thread::sleep(LOOKS);
            }
        })?;
        Ok(self)
    }
}

/// Returns the offset that LinuxCNC applies to an axis, mm; `None` if LinuxCNC has ended.
fn offset_mm(asks: &mut ChildStdin, says: &mut BufReader<ChildStdout>, axis: &str) -> Option<f64> {
    writeln!(asks, "get axis.{axis}.eoffset").ok()?;
    let mut line = String::new();
    says.read_line(&mut line).ok().filter(|count| *count > 0)?;
    line.trim().strip_prefix("ok")?.trim().parse().ok()
}

fn write_files(directory: &Path) -> std::io::Result<()> {
    std::fs::DirBuilder::new().mode(0o700).create(directory)?;
    for (place, (name, text)) in FILES.into_iter().enumerate() {
        let path = directory.join(name);
        std::fs::create_dir_all(path.parent().unwrap_or(directory))?;
        std::fs::write(&path, text)?;
        if place < PROGRAMS {
            std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o755))?;
        }
    }
    Ok(())
}

impl Drop for Mill {
    fn drop(&mut self) {
        // The end of its standard input would stop LinuxCNC as well, but the polling thread holds that pipe.
        let asked = Command::new("kill").arg(self.child.id().to_string()).status();
        if asked.is_ok_and(|status| status.success()) || self.child.kill().is_ok() {
            let _ = self.child.wait();
        }
        let _ = std::fs::remove_dir_all(&self.directory);
    }
}
