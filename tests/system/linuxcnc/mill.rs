//! LinuxCNC without a screen, controlled line by line.

use std::path::{Path, PathBuf};
use std::process::Command;

use crate::linuxcnc::process::{PATIENCE, Running, free_port};
use crate::linuxcnc::samples::Samples;
use crate::support::starved::Starved;

/// Columns that the sampler records, in its order.
const COLUMNS: [&str; 6] = [
    "axis.z.eoffset",
    "axis.z.eoffset-request",
    "axis.z.pos-cmd",
    "joint.2.pos-cmd",
    "joint.2.f-error",
    "motion.motion-enabled",
];

/// A simulated mill with its component; it ends when it is dropped.
pub(crate) struct Mill {
    running: Running,
    pub(crate) port: u16,
    directory: tempfile::TempDir,
    recordings: usize,
    /// Wait of the servo thread for a processor during the recording.
    starved: Vec<Starved>,
}

impl Mill {
    /// Starts a mill that is on, homed, in teleop mode, at X0 Y0 Z0.
    pub(crate) fn start() -> Mill {
        let port = free_port();
        let directory = tempfile::tempdir().unwrap();
        Mill { running: runs(port), port, directory, recordings: 0, starved: Vec::new() }
    }

    /// Ends LinuxCNC, and starts it again.
    #[track_caller]
    pub(crate) fn restarts(&mut self) {
        self.running.signal("TERM");
        self.running.ends_within(PATIENCE);
        self.running = runs(self.port);
    }

    /// Sends a line to LinuxCNC, and returns its answer.
    #[track_caller]
    pub(crate) fn command(&mut self, line: &str) -> String {
        use std::io::Write;
        writeln!(self.running.stdin(), "{line}").unwrap();
        let answer = self.running.hears_one_of(&["ok", "error"]);
        assert!(answer.starts_with("ok"), "{line}: {answer}");
        answer.trim_start_matches("ok").trim().to_owned()
    }

    /// Value of a pin.
    #[track_caller]
    pub(crate) fn pin(&mut self, name: &str) -> f64 {
        let answer = self.command(&format!("get {name}"));
        match answer.as_str() {
            "TRUE" => 1.0,
            "FALSE" => 0.0,
            number => number.parse().unwrap_or_else(|_| panic!("{name} is {number}")),
        }
    }

    /// Offset of Z in addition to its program, µm.
    #[track_caller]
    pub(crate) fn offset_um(&mut self) -> f64 {
        1000.0 * self.pin("axis.z.eoffset")
    }

    /// Starts to record every servo period.
    pub(crate) fn records(&mut self) {
        self.recordings += 1;
        self.starved = realtime().map(Starved::of).collect();
        let file = self.recording();
        self.command(&format!("sample start {}", file.display()));
    }

    fn recording(&self) -> PathBuf {
        self.directory.path().join(format!("{}.samples", self.recordings))
    }

    /// Ends the recording.
    #[track_caller]
    pub(crate) fn recorded(&mut self) -> Samples {
        self.command("sample stop");
        let text = std::fs::read_to_string(self.recording()).unwrap();
        let waited = self.starved.iter().map(Starved::longest).max().unwrap_or_default();
        let Samples(samples, _) = Samples::parse(&text, &COLUMNS);
        Samples(samples, waited)
    }
}

/// Processes that run the servo thread.
fn realtime() -> impl Iterator<Item = u32> {
    let processes = std::fs::read_dir("/proc").into_iter().flatten().flatten();
    let numbers = processes.filter_map(|process| process.file_name().to_str()?.parse::<u32>().ok());
    numbers.filter(|number| {
        let name = std::fs::read_to_string(format!("/proc/{number}/comm"));
        name.is_ok_and(|name| name.starts_with("rtapi_app"))
    })
}

fn runs(port: u16) -> Running {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("profiles/linuxcnc");
    let mut command = Command::new(folder.join("headless"));
    let mut running = Running::start(command.args(["--home", "--port", &port.to_string()]));
    running.receives("ready");
    running
}

impl Drop for Mill {
    fn drop(&mut self) {
        self.running.signal("TERM");
        let _ = self.running.ends_within(PATIENCE);
    }
}
