//! Directory in which the commands of a chapter run: the manual's profile, logs of three cold starts, and its devices
//! as virtual ones.

use std::fmt::Write;
use std::io::{Read, Write as _};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

use super::book::{Chapter, chapters};
use super::process::{Running, file, free_port, isotherm, until};

/// The machine of the manual with virtual devices.
pub(crate) struct Shop {
    home: tempfile::TempDir,
    pub(crate) profile: String,
    /// Address of the page of the running gateway or demo.
    page: Option<String>,
    /// Input for the next commands.
    pub(crate) typed: &'static str,
    /// Programs that run until the block ends.
    beside: Vec<Running>,
    /// Virtual devices, if the chapter does not start them itself.
    _devices: Option<Running>,
}

impl Shop {
    pub(crate) fn of(chapter: &Chapter) -> Shop {
        let home = tempfile::tempdir().unwrap();
        // The profile has a separate port, and a period of one second instead of ten, to save time.
        let profile = whole_profile()
            .replace("127.0.0.1:15020", &format!("127.0.0.1:{}", free_port()))
            .replace("every    = \"10s\"", "every    = \"1s\" ");
        file(home.path(), "my-machine.toml", &profile);
        std::fs::create_dir(home.path().join("campaign")).unwrap();
        for (index, day) in ["mon", "tue", "wed"].iter().enumerate() {
            let log = cold_start(index);
            file(home.path(), &format!("{day}.csv"), &log);
            file(home.path(), &format!("campaign/{day}.csv"), &log);
        }
        file(home.path(), "touches.csv", &touches());
        let starts_them = chapter.text.contains("\nisotherm virtual my-machine.toml");
        let mut shop = Shop { home, profile, page: None, typed: "", beside: Vec::new(), _devices: None };
        shop._devices = (!starts_them).then(|| shop.begun("isotherm virtual my-machine.toml", "listens on"));
        shop
    }

    pub(crate) fn home(&self) -> &Path {
        self.home.path()
    }

    /// Shell command for a line, with the tested `isotherm` first on the path.
    fn shell(&self, line: &str) -> Command {
        let mut command = isotherm(self.home());
        let program = Path::new(command.get_program()).parent().unwrap().to_owned();
        let path = format!("{}:{}", program.display(), std::env::var("PATH").unwrap());
        command = Command::new("sh");
        command.env_clear().env("HOME", self.home()).env("PATH", path).current_dir(self.home());
        command.args(["-c", &format!("exec {line}")]);
        command
    }

    /// Starts a program that continues to run, and waits until it prints `word`.
    pub(crate) fn begun(&mut self, line: &str, word: &str) -> Running {
        let mut running = Running::start(&mut self.shell(line));
        running.receives(word);
        let page = running.said.iter().find_map(|said| said.split_once("http://"));
        self.page = page.map(|(_, page)| page.trim_end_matches('/').to_owned()).or(self.page.take());
        running
    }

    /// Runs a line until it ends, or until it has started if it continues to run. Returns its output and its exit code.
    pub(crate) fn run(&mut self, line: &str) -> (String, i32) {
        let line = self.today(line);
        let line = self.page.as_ref().map_or(line.clone(), |page| line.replace("127.0.0.1:8080", page));
        let resumes = match line.split_whitespace().nth(1) {
            Some("virtual") => Some("listens on"),
            Some("run") => Some("the gateway runs"),
            Some("demo") if line.contains("--stay") => Some("http://"),
            _ => None,
        };
        if let Some(word) = resumes {
            let running = self.begun(&line, word);
            self.beside.push(running);
            return (String::new(), 0);
        }
        // Both streams use one pipe, as on a terminal.
        let (mut receives, says) = std::io::pipe().unwrap();
        let mut command = self.shell(&line);
        command.stdin(Stdio::piped()).stdout(says.try_clone().unwrap()).stderr(says);
        let mut child = command.spawn().unwrap();
        drop(command);
        // A command that reads no input may have ended already.
        let _ = child.stdin.take().unwrap().write_all(self.typed.as_bytes());
        let mut said = String::new();
        receives.read_to_string(&mut said).unwrap();
        (said, child.wait().unwrap().code().unwrap_or(-1))
    }

    /// Ends the running programs, the last first, as Ctrl-C does. A gateway has then decided several times.
    pub(crate) fn end_of_block(&mut self) {
        if self.home().join("state").is_dir() {
            until("the gateway has decided", || match self.rows() {
                rows if rows > 3 => Ok(()),
                rows => Err(format!("{rows} rows")),
            });
        }
        while let Some(mut running) = self.beside.pop() {
            running.signal("INT");
            running.ends_within(Duration::from_secs(30));
        }
    }

    /// Name of today's log in `state`.
    fn log(&self) -> Option<String> {
        let names = std::fs::read_dir(self.home().join("state")).ok()?;
        let mut names = names.map(|entry| entry.unwrap().file_name().into_string().unwrap());
        names.find(|name| name.ends_with(".csv") && !name.contains("outputs"))
    }

    fn rows(&self) -> usize {
        let text =
            self.log().map(|log| std::fs::read_to_string(self.home().join("state").join(log)).unwrap());
        text.map_or(0, |text| text.lines().count().saturating_sub(1))
    }

    /// Replaces the log of the manual, which has another date.
    fn today(&self, line: &str) -> String {
        let (Some(begin), Some(log)) = (line.find("my-machine-2"), self.log()) else {
            return line.to_owned();
        };
        let end = line[begin..].find(".csv").map_or(line.len(), |length| begin + length + 4);
        format!("{}{log}{}", &line[..begin], &line[end..])
    }

    /// Replaces the profile of the machine.
    pub(crate) fn write_profile(&self, text: &str) {
        file(self.home(), "my-machine.toml", text);
    }

    /// Writes the profile with the mistakes of README.
    pub(crate) fn make_mistakes(&self) {
        let wrong =
            self.profile.replace("deadband", "dedband").replace("{ signal = \"bed\"", "{ signal = \"bad\"");
        assert_ne!(wrong, self.profile);
        self.write_profile(&wrong);
    }
}

/// The only whole profile of the manual.
fn whole_profile() -> String {
    let blocks = chapters().into_iter().flat_map(|chapter| chapter.blocks());
    blocks.filter(|block| block.language == "toml").find(|block| block.marks.is_empty()).unwrap().text
}

/// Log of eight hours, minute by minute: the bed warms by some degrees, and the error follows with −4 µm/°C.
pub(crate) fn cold_start(day: usize) -> String {
    let mut log = "time_min,bed,column,head,z_error_um\n".to_owned();
    let rise = 4.0 + day as f64;
    for minute in 0..480 {
        let warm = rise * (1.0 - (-f64::from(minute) / 120.0).exp());
        let noise = 0.05 * (f64::from(minute) * (1.7 + day as f64)).sin();
        let late = rise * (1.0 - (-f64::from(minute) / 200.0).exp());
        let error = 4.0 * warm + noise;
        writeln!(log, "{minute},{:.2},{:.2},{:.2},{error:.3}", 20.0 + warm, 20.0 + late, 20.0 + 0.3 * warm)
            .unwrap();
    }
    log
}

/// Touches of five balls along x, every half hour, on a machine that rises and expands.
fn touches() -> String {
    let mut touches = "time_min,ball,x_mm,y_mm,z_mm\n".to_owned();
    for round in 0..16 {
        let warm = f64::from(round) * 0.0005;
        for ball in 0..5 {
            let x = 100.0 * f64::from(ball);
            let minute = round * 30;
            writeln!(
                touches,
                "{minute},{},{:.4},{:.4},{:.4}",
                ball + 1,
                x + warm,
                warm / 2.0,
                -warm * (1.0 + x / 1000.0)
            )
            .unwrap();
        }
    }
    touches
}
