//! A gateway with its page and its device, and clients over real sockets.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::{IpAddr, SocketAddr, TcpListener, TcpStream};
use std::os::unix::fs::PermissionsExt;
use std::path::PathBuf;
use std::time::Duration;

use serde_json::Value;
use socket2::{Domain, Socket, Type};

use crate::device::{Device, Times, profile};
use crate::on_time::OnTime;
use crate::process::{Running, file, isotherm, until};

/// Timeouts for a device in this process: see `rig`.
const TIMES: Times = Times {
    timeout: Duration::from_secs(5),
    every: Duration::from_millis(500),
    max_age: Duration::from_secs(5),
};
pub(crate) const OPERATOR: &str = "commands-and-more-than-that";
pub(crate) const VIEWER: &str = "looks-and-no-more-than-that";
pub(crate) const SCRAPER: &str = "collects-figures-and-no-more";
/// Profile lines for the operator's and the viewer's token.
pub(crate) const BOTH: &str = "token_file = \"operator.token\"\nviewer_token_file = \"viewer.token\"\n";

/// Profile line for the scraper's token.
pub(crate) const SCRAPES: &str = "scrape_token_file = \"scrape.token\"\n";

pub(crate) struct Site {
    /// Dropped, and thus checked, before anything ends: the machine must be compensated on time during the test.
    on_time: Option<OnTime>,
    pub(crate) home: tempfile::TempDir,
    pub(crate) device: Device,
    pub(crate) profile: PathBuf,
    pub(crate) gateway: Running,
    pub(crate) address: SocketAddr,
}

/// Answer of the page.
#[derive(Debug)]
pub(crate) struct Reply {
    pub(crate) code: u16,
    pub(crate) head: String,
    pub(crate) body: String,
}

impl Reply {
    pub(crate) fn parse(text: &str) -> Reply {
        let (head, body) = text.split_once("\r\n\r\n").unwrap_or_else(|| panic!("no answer: {text:?}"));
        let code = head.split(' ').nth(1).unwrap().parse().unwrap();
        Reply { code, head: head.to_owned(), body: body.to_owned() }
    }

    pub(crate) fn header(&self, name: &str) -> &str {
        let mut pairs = self.head.lines().filter_map(|line| line.split_once(": "));
        pairs.find(|(known, _)| known.eq_ignore_ascii_case(name)).map_or("", |(_, value)| value)
    }

    pub(crate) fn json(&self) -> Value {
        serde_json::from_str(&self.body).unwrap_or_else(|error| panic!("{error}: {}", self.body))
    }
}

/// Connects from this address of the computer to a server.
pub(crate) fn connected(from: IpAddr, to: SocketAddr) -> TcpStream {
    let socket = Socket::new(Domain::IPV4, Type::STREAM, None).unwrap();
    socket.bind(&SocketAddr::from((from, 0)).into()).unwrap();
    socket.connect(&to.into()).unwrap();
    let stream = TcpStream::from(socket);
    stream.set_read_timeout(Some(Duration::from_secs(30))).unwrap();
    stream
}

/// Header with a token.
pub(crate) fn bearer(token: &str) -> String {
    format!("Authorization: Bearer {token}\r\n")
}

impl Site {
    /// Starts a gateway with these lines in `[web]`. Its axis is off until an operator arms it.
    pub(crate) fn with(web: &str) -> Site {
        Site::of(web, |text| text.replace("arm = \"auto\"", "arm = \"manual\""))
    }

    pub(crate) fn of(web: &str, change: impl FnOnce(String) -> String) -> Site {
        Site::at("127.0.0.1", web, change)
    }

    /// Starts a gateway with the page at another address than loopback.
    pub(crate) fn at(listen: &str, web: &str, change: impl FnOnce(String) -> String) -> Site {
        let device = Device::listen(TcpListener::bind("127.0.0.1:0").unwrap(), Duration::ZERO);
        let home = tempfile::tempdir().unwrap();
        let text = profile(device.address(), TIMES).replace("100ms", "5ms");
        let text = format!("{}\n[web]\nlisten = \"{listen}:0\"\n{web}", change(text));
        let profile = file(home.path(), "walker.toml", &text);
        let scrapes = web.contains(SCRAPES).then_some(("scrape.token", SCRAPER));
        for (name, token) in
            [("operator.token", OPERATOR), ("viewer.token", VIEWER)].into_iter().chain(scrapes)
        {
            let path = file(home.path(), name, &format!("{token}\n"));
            std::fs::set_permissions(path, std::fs::Permissions::from_mode(0o600)).unwrap();
        }
        let mut command = isotherm(home.path());
        command
            .current_dir(home.path())
            .arg("run")
            .arg(&profile)
            .arg("--state")
            .arg(home.path().join("state"));
        let mut gateway = Running::start(&mut command);
        let page = gateway.receives("page http://");
        let port = page.rsplit(':').next().unwrap();
        let address = SocketAddr::from(([127, 0, 0, 1], port.parse().unwrap()));
        let on_time = OnTime::from_now(&device, TIMES.every, gateway.id());
        Site { on_time: Some(on_time), home, device, profile, gateway, address }
    }

    /// Ends the check of poll times, because the next steps may delay polls, for example an interrupted line.
    pub(crate) fn was_on_time(&mut self) {
        drop(self.on_time.take());
    }

    /// Runs a verb for this machine. Returns its exit code and its output.
    pub(crate) fn verb(&self, words: &[&str]) -> (i32, String) {
        let (verb, options) = words.split_first().unwrap();
        let mut command = isotherm(self.home.path());
        command.current_dir(self.home.path()).arg(verb).arg(&self.profile).args(options);
        let output = command.arg("--state").arg(self.home.path().join("state")).output().unwrap();
        let said = [output.stdout, output.stderr].map(|said| String::from_utf8(said).unwrap()).concat();
        (output.status.code().unwrap(), said)
    }

    /// Replaces the content of a token file.
    pub(crate) fn token(&self, name: &str, token: &str) {
        std::fs::write(self.home.path().join(name), token).unwrap();
    }

    /// Connects from this address of the computer.
    pub(crate) fn connect(&self, from: &str) -> TcpStream {
        let from: IpAddr = from.parse().unwrap();
        // A client with another address than loopback connects to that address.
        let to =
            if from.is_loopback() { self.address } else { SocketAddr::from((from, self.address.port())) };
        connected(from, to)
    }

    pub(crate) fn get(&self, path: &str, headers: &str) -> Reply {
        self.send("GET", path, headers, "")
    }

    pub(crate) fn post(&self, path: &str, headers: &str) -> Reply {
        self.send("POST", path, headers, "")
    }

    pub(crate) fn send(&self, method: &str, path: &str, headers: &str, body: &str) -> Reply {
        self.send_from("127.0.0.1", method, path, headers, body)
    }

    pub(crate) fn send_from(&self, from: &str, method: &str, path: &str, headers: &str, body: &str) -> Reply {
        let mut stream = self.connect(from);
        let headers = format!("Connection: close\r\n{headers}");
        stream.write_all(self.request(method, path, &headers, body).as_bytes()).unwrap();
        let mut text = String::new();
        stream.read_to_string(&mut text).unwrap();
        Reply::parse(&text)
    }

    fn request(&self, method: &str, path: &str, headers: &str, body: &str) -> String {
        let host = self.address;
        let length = body.len();
        format!("{method} {path} HTTP/1.1\r\nHost: {host}\r\n{headers}Content-Length: {length}\r\n\r\n{body}")
    }

    /// Sends the same request repeatedly on one connection, a hundred at a time, as long as `resumes` returns true.
    /// Returns the number of answers with each code.
    pub(crate) fn floods(
        &self,
        (method, path, headers, body): (&str, &str, &str, &str),
        mut resumes: impl FnMut(usize) -> bool,
    ) -> Vec<(u16, usize)> {
        let batch = self.request(method, path, headers, body).repeat(100);
        let mut writer = self.connect("127.0.0.1");
        let mut reader = BufReader::new(writer.try_clone().unwrap());
        let (mut codes, mut sent) = (Vec::new(), 0);
        while resumes(sent) {
            writer.write_all(batch.as_bytes()).unwrap();
            for _ in 0..100 {
                let code = answered(&mut reader);
                match codes.iter_mut().find(|(known, _)| *known == code) {
                    Some((_, count)) => *count += 1,
                    None => codes.push((code, 1)),
                }
            }
            sent += 100;
        }
        codes
    }

    pub(crate) fn status(&self) -> Value {
        let reply = self.get("/api/status", &bearer(OPERATOR));
        assert_eq!(reply.code, 200, "{reply:?}");
        reply.json()
    }

    /// Waits until the axis can be armed at once.
    #[track_caller]
    pub(crate) fn is_known(&self) {
        until("a good reading, and the register is known", || match &self.status()["axes"][0] {
            axis if axis["raw_um"].is_number() && axis["verified_um"].is_number() => Ok(()),
            axis => Err(axis.to_string()),
        });
    }
}

/// Reads one answer with its body, and returns its code.
fn answered(reader: &mut impl BufRead) -> u16 {
    let (mut code, mut length) = (0, 0);
    loop {
        let mut line = String::new();
        assert_ne!(reader.read_line(&mut line).unwrap(), 0, "the connection has ended");
        let line = line.trim_end();
        if let Some(rest) = line.strip_prefix("HTTP/1.1 ") {
            code = rest[..3].parse().unwrap();
        } else if let Some((name, value)) = line.split_once(": ")
            && name.eq_ignore_ascii_case("content-length")
        {
            length = value.parse().unwrap();
        } else if line.is_empty() {
            reader.read_exact(&mut vec![0; length]).unwrap();
            return code;
        }
    }
}
