//! Outgoing connections and kept data. The gateway has only sockets of devices, page and commands, and only the files
//! that the manual lists. The files contain only names of users who sent commands.

use std::collections::{BTreeMap, BTreeSet};
use std::io::{Read, Write};
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, UdpSocket};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use crate::process::{PATIENCE, until};
use crate::site::{BOTH, OPERATOR, Site, VIEWER, bearer};

/// Interval of the samples. A name lookup, or a connection to a silent host, takes longer.
const LOOKS_EVERY: Duration = Duration::from_millis(20);
/// Maximum number of samples in which a socket may be in no table, before it connects or after a reset.
const STANDS_NOWHERE: usize = 200;
/// Number of sockets of the pair that delivers signals to the runtime.
const OF_SIGNALS: usize = 2;

/// A socket of a process, as the kernel lists it.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Socket {
    Listens(SocketAddr),
    Tcp {
        own: SocketAddr,
        other: SocketAddr,
    },
    /// UDP, raw or packet socket.
    Datagrams(&'static str),
    Unix(String),
    Unknown,
}

/// Sockets of this process, by inode.
fn sockets(process: u32) -> BTreeMap<u64, Socket> {
    let proc = Path::new("/proc").join(process.to_string());
    let Ok(entries) = std::fs::read_dir(proc.join("fd")) else { return BTreeMap::new() };
    let links = entries.filter_map(|entry| std::fs::read_link(entry.ok()?.path()).ok());
    let inode = |link: &Path| link.to_str()?.strip_prefix("socket:[")?.strip_suffix(']')?.parse().ok();
    let mut found: BTreeMap<u64, Socket> =
        links.filter_map(|link| Some((inode(&link)?, Socket::Unknown))).collect();
    let mut is = |inode: Option<&str>, socket: &dyn Fn() -> Option<Socket>| {
        let known = inode.and_then(|inode| inode.parse().ok()).and_then(|inode: u64| found.get_mut(&inode));
        if let Some(known) = known {
            *known = socket().unwrap_or(Socket::Unknown);
        }
    };
    let table = |name: &str| std::fs::read_to_string(proc.join("net").join(name)).unwrap_or_default();
    for name in ["tcp", "tcp6"] {
        for line in table(name).lines().skip(1) {
            let words: Vec<&str> = line.split_whitespace().collect();
            is(words.get(9).copied(), &|| {
                let (own, other) = (address(words[1])?, address(words[2])?);
                Some(if words[3] == "0A" { Socket::Listens(own) } else { Socket::Tcp { own, other } })
            });
        }
    }
    for name in ["udp", "udp6", "udplite", "udplite6", "raw", "raw6", "icmp", "icmp6"] {
        for line in table(name).lines().skip(1) {
            is(line.split_whitespace().nth(9), &|| Some(Socket::Datagrams(name)));
        }
    }
    for name in ["packet", "netlink"] {
        for line in table(name).lines().skip(1) {
            let place = if name == "packet" { 8 } else { 9 };
            is(line.split_whitespace().nth(place), &|| Some(Socket::Datagrams(name)));
        }
    }
    for line in table("unix").lines().skip(1) {
        let words: Vec<&str> = line.split_whitespace().collect();
        is(words.get(6).copied(), &|| Some(Socket::Unix(words[7..].join(" "))));
    }
    found
}

/// Parses `0100007F:1F90`: words in the byte order of this computer, then the port.
fn address(text: &str) -> Option<SocketAddr> {
    let (host, port) = text.split_once(':')?;
    let words = (0..host.len() / 8).map(|word| u32::from_str_radix(&host[word * 8..word * 8 + 8], 16).ok());
    let bytes: Vec<u8> =
        words.collect::<Option<Vec<u32>>>()?.into_iter().flat_map(u32::to_ne_bytes).collect();
    let host: IpAddr = match bytes.len() {
        4 => Ipv4Addr::from(<[u8; 4]>::try_from(bytes).ok()?).into(),
        _ => Ipv6Addr::from(<[u8; 16]>::try_from(bytes).ok()?).to_canonical(),
    };
    Some(SocketAddr::new(host, u16::from_str_radix(port, 16).ok()?))
}

/// Allowed targets of a gateway's sockets.
#[derive(Clone, Debug)]
struct May {
    page: SocketAddr,
    devices: Vec<SocketAddr>,
    commands: String,
}

impl May {
    fn allows(&self, socket: &Socket) -> bool {
        match socket {
            Socket::Listens(own) => *own == self.page,
            Socket::Tcp { own, other } => *own == self.page || self.devices.contains(other),
            // Each gateway announces its registers to other gateways of this computer over an abstract socket.
            Socket::Unix(path) => {
                *path == self.commands || path.is_empty() || path.starts_with("@isotherm/1/")
            }
            Socket::Datagrams(_) => false,
            Socket::Unknown => true,
        }
    }
}

/// Samples the sockets of a process in a thread until it is stopped.
struct Watch {
    ends: Arc<AtomicBool>,
    thread: JoinHandle<Watched>,
}

#[derive(Debug, Default)]
struct Watched {
    looks: usize,
    seen: BTreeSet<Socket>,
    foreign: BTreeSet<String>,
}

impl Watch {
    fn of(process: u32, may: May) -> Watch {
        let ends = Arc::new(AtomicBool::new(false));
        let until = Arc::clone(&ends);
        let thread = std::thread::spawn(move || {
            let (mut watched, mut nowhere) = (Watched::default(), BTreeMap::<u64, usize>::new());
            loop {
                // The sockets at the time of the stop are sampled as well.
                let is_last = until.load(Ordering::Relaxed);
                let found = sockets(process);
                let unnamed = found.values().filter(|socket| **socket == Socket::Unix(String::new())).count();
                if unnamed > OF_SIGNALS {
                    watched.foreign.insert(format!("{unnamed} sockets of this computer without a name"));
                }
                nowhere.retain(|inode, _| found.get(inode) == Some(&Socket::Unknown));
                for (inode, socket) in found {
                    if socket == Socket::Unknown {
                        let looks = nowhere.entry(inode).or_default();
                        *looks += 1;
                        if *looks > STANDS_NOWHERE {
                            watched.foreign.insert(String::from("a socket that stands in no table"));
                        }
                    } else if !may.allows(&socket) {
                        watched.foreign.insert(format!("{socket:?}"));
                    }
                    watched.seen.insert(socket);
                }
                watched.looks += 1;
                if is_last {
                    return watched;
                }
                std::thread::sleep(LOOKS_EVERY);
            }
        });
        Watch { ends, thread }
    }

    fn saw(self) -> Watched {
        self.ends.store(true, Ordering::Relaxed);
        self.thread.join().unwrap()
    }
}

/// Files of the state directory that the manual lists.
fn listed() -> Vec<String> {
    let chapter = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/time-and-state.md");
    let chapter = std::fs::read_to_string(chapter).unwrap();
    let section = chapter.split("## What lies in the state directory").nth(1).unwrap();
    let section = section.split("\n## ").next().unwrap();
    let rows = section.lines().filter(|line| line.starts_with("| `"));
    let first = rows.filter_map(|row| row.split('|').nth(1));
    first.flat_map(|cell| cell.split('`').skip(1).step_by(2)).map(str::to_owned).collect()
}

/// Returns whether a file name matches a pattern of the manual: `walker-2026-01-31.2.csv` matches `NAME-DATE.csv` for
/// the machine `walker`.
fn is_of(file: &str, pattern: &str, machine: &str) -> bool {
    let pattern = pattern.replace("NAME", machine);
    let Some((before, behind)) = pattern.split_once("DATE") else { return file == pattern };
    let Some(rest) = file.strip_prefix(before) else { return false };
    let Some(date) = rest.strip_suffix(behind) else { return false };
    let (day, number) = date.split_once('.').unwrap_or((date, "0"));
    day.len() == 10
        && day.chars().all(|c| c.is_ascii_digit() || c == '-')
        && number.chars().all(|c| c.is_ascii_digit())
}

fn names_in(directory: &Path) -> BTreeSet<String> {
    let entries = std::fs::read_dir(directory).unwrap().map(|entry| entry.unwrap().file_name());
    entries.map(|name| name.into_string().unwrap()).collect()
}

fn has_word(text: &str, word: &str) -> bool {
    text.split(|c: char| !c.is_alphanumeric() && !"-_".contains(c)).any(|other| other == word)
}

/// Address of a client that only views.
const LOOKER: &str = "127.0.0.9";
/// Address of a client that sends commands.
const COMMANDER: &str = "127.0.0.8";

#[test]
fn a_gateway_goes_to_nobody_but_its_devices_and_keeps_nothing_but_what_is_listed() {
    let mut site = Site::with(BOTH);
    let state = site.home.path().join("state");
    let may = May {
        page: site.address,
        devices: vec![site.device.address()],
        commands: state.join("walker.sock").to_str().unwrap().to_owned(),
    };
    let watch = Watch::of(site.gateway.id(), may.clone());
    site.is_known();
    for path in ["/", "/page/main.js", "/api/status", "/api/events?since=1h", "/metrics", "/nowhere"] {
        site.send_from(LOOKER, "GET", path, &bearer(VIEWER), "");
    }
    let mut looks_on = site.connect(LOOKER);
    let live = format!(
        "GET /api/live HTTP/1.1\r\nHost: {}\r\nReferer: http://somebody-who-looks/\r\n{}\r\n",
        site.address,
        bearer(VIEWER)
    );
    looks_on.write_all(live.as_bytes()).unwrap();
    assert!(looks_on.read(&mut [0; 1000]).unwrap() > 0);
    let armed = site.send_from(COMMANDER, "POST", "/api/arm", &bearer(OPERATOR), "");
    assert_eq!(armed.code, 200, "{armed:?}");
    // Its line is interrupted once, and works again.
    site.was_on_time();
    site.device.is_down(true);
    std::thread::sleep(Duration::from_secs(1));
    site.device.is_down(false);
    until("the machine is held again", || match &site.status()["axes"][0] {
        axis if axis["state"] == "following" || axis["verified_um"].is_number() => Ok(()),
        axis => Err(axis.to_string()),
    });
    let (code, said) = site.verb(&["disarm"]);
    assert_eq!(code, 0, "{said}");
    let (_, events) = site.verb(&["events", "--json"]);
    let watched = watch.saw();
    println!("{} looks, {:?}", watched.looks, watched.seen);
    assert_eq!(watched.foreign, BTreeSet::new(), "{may:?}");
    let is_to = |whom: &dyn Fn(&Socket) -> bool| watched.seen.iter().any(whom);
    assert!(is_to(&|socket| matches!(socket, Socket::Tcp { other, .. } if may.devices.contains(other))));
    assert!(is_to(&|socket| matches!(socket, Socket::Tcp { other, .. } if other.ip().to_string() == LOOKER)));
    assert!(is_to(&|socket| *socket == Socket::Listens(may.page)));
    assert!(is_to(&|socket| *socket == Socket::Unix(may.commands.clone())));

    let before = names_in(&state);
    site.gateway.signal("TERM");
    assert!(site.gateway.ends_within(PATIENCE).success());
    let listed = listed();
    let kept = names_in(&state);
    for file in kept.iter().chain(&before) {
        let is_listed = listed.iter().any(|pattern| is_of(file, pattern, "walker"));
        assert!(is_listed, "{file} is not among what the manual lists: {listed:?}");
    }
    // The socket is gone with the gateway, its device has no template, its axis does not learn, and nothing was handed
    // over.
    let passing = [".sock", ".templates.", ".handover", ".products"];
    let lasting = listed.iter().filter(|pattern| !passing.iter().any(|kind| pattern.contains(kind)));
    for pattern in lasting {
        assert!(kept.iter().any(|file| is_of(file, pattern, "walker")), "{pattern}: {kept:?}");
    }
    let beside = ["operator.token", "state", "viewer.token", "walker.toml"];
    assert_eq!(names_in(site.home.path()), beside.map(str::to_owned).into());

    let user = std::process::Command::new("id").arg("-un").output().unwrap();
    let user = String::from_utf8(user.stdout).unwrap().trim().to_owned();
    let host = std::fs::read_to_string("/proc/sys/kernel/hostname").unwrap().trim().to_owned();
    let home = site.home.path().file_name().unwrap().to_str().unwrap();
    assert!(has_word(&events, &user) && events.contains(COMMANDER), "who commanded is known: {events}");
    for file in &kept {
        let Ok(text) = std::fs::read_to_string(state.join(file)) else { continue };
        for nobody in [LOOKER, VIEWER, OPERATOR, "somebody-who-looks", home] {
            assert!(!text.contains(nobody), "{nobody} stands in {file}");
        }
        let lines = text.lines().filter(|line| !line.contains("\"kind\":\"command\""));
        for line in lines.filter(|line| !line.contains("\"kind\":\"armed\"")) {
            assert!(!has_word(line, &user) && !line.contains(COMMANDER), "{file}: {line}");
        }
        // A host name that occurs in every log as another name cannot be distinguished.
        if host.len() > 1 && !["walker", "bed", "cnc", "cnc_z", "localhost"].contains(&host.as_str()) {
            assert!(!has_word(&text, &host), "{host} stands in {file}");
        }
    }
}

#[test]
fn a_socket_to_somebody_else_is_seen_of_whatever_kind() {
    let site = Site::with(BOTH);
    let may = May { page: site.address, devices: Vec::new(), commands: String::new() };
    // This process has many other sockets, so that the test looks for its own among them.
    let watch = Watch::of(std::process::id(), may);
    let other = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let tcp = std::net::TcpStream::connect(other.local_addr().unwrap()).unwrap();
    let other6 = std::net::TcpListener::bind("[::1]:0").ok();
    let udp = UdpSocket::bind("127.0.0.1:0").unwrap();
    let unix = std::os::unix::net::UnixListener::bind(site.home.path().join("other.sock")).unwrap();
    std::thread::sleep(20 * LOOKS_EVERY);
    let watched = watch.saw();
    let mut expected = vec![
        Socket::Listens(other.local_addr().unwrap()),
        Socket::Tcp { own: tcp.local_addr().unwrap(), other: tcp.peer_addr().unwrap() },
        Socket::Datagrams("udp"),
        Socket::Unix(site.home.path().join("other.sock").to_str().unwrap().to_owned()),
    ];
    expected.extend(other6.as_ref().map(|other| Socket::Listens(other.local_addr().unwrap())));
    for socket in expected {
        assert!(watched.foreign.contains(&format!("{socket:?}")), "{socket:?} in {:?}", watched.foreign);
    }
    drop((udp, unix));
}
