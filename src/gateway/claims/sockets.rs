//! Abstract sockets by which gateways find each other, for example `isotherm/1/4711-5f2c01aa/9e3779b9…`. The name
//! contains the process id, a random number, and a short hash of each bus address. Two gateways without a common hash
//! do not exchange their claims.

use std::collections::BTreeSet;
use std::io::{self, Read, Write};
use std::os::linux::net::SocketAddrExt;
use std::os::unix::net::{SocketAddr, UnixListener, UnixStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use socket2::{Domain, SockAddr, Socket, Type};

use super::Claim;

/// Prefix of all socket names. The number in the prefix changes when the format of a claim changes.
const PREFIX: &str = "isotherm/1/";
/// Text in place of the hashes, if the socket name is too short for all of them.
const MANY: &str = "*";
const MOST_HASHES: usize = 9;
const HASH: usize = 8;
/// Flag in the kernel's list of sockets: the socket accepts connections.
const ACCEPTS: u32 = 0x1_0000;
/// Maximum wait for the claim of another gateway. A separate thread of that gateway sends the claim.
const PATIENCE: Duration = Duration::from_secs(2);
/// Maximum size of an accepted claim, in bytes.
const LARGEST: u64 = 16_000_000;
/// Pause after each sent claim. Without it, a client that connects as fast as possible would delay the bus lines.
const PAUSE: Duration = Duration::from_millis(5);

/// Listening socket of this gateway. It exists until the process ends.
pub(super) struct Listener {
    is_held: Arc<AtomicBool>,
}

impl Listener {
    /// Opens the socket, and starts the thread that sends the claim to each client.
    pub(super) fn open(claim: Claim) -> io::Result<Listener> {
        let name = format!("{PREFIX}{}-{:08x}/{}", claim.process, claim.order, joined(&hashes(&claim)));
        let listener = UnixListener::bind_addr(&SocketAddr::from_abstract_name(name)?)?;
        let is_held = Arc::new(AtomicBool::new(false));
        let held = is_held.clone();
        std::thread::Builder::new().name("claims".to_owned()).spawn(move || {
            let mut claim = claim;
            for stream in listener.incoming() {
                claim.is_held = held.load(Ordering::Relaxed);
                // A client that does not read gets no second try.
                let _ = stream.and_then(|stream| send(stream, &claim));
                std::thread::sleep(PAUSE);
            }
        })?;
        Ok(Listener { is_held })
    }

    /// Marks the claim as valid, because no other gateway writes to these registers. A gateway that starts later must
    /// then end.
    pub(super) fn hold(&self) {
        self.is_held.store(true, Ordering::Relaxed);
    }
}

fn send(mut stream: UnixStream, claim: &Claim) -> io::Result<()> {
    stream.set_write_timeout(Some(PATIENCE))?;
    stream.write_all(&serde_json::to_vec(claim)?)
}

/// Another gateway that may write to the same registers.
pub(super) struct Other {
    name: String,
    pub(super) process: u32,
    /// Whether the names of both sockets contain the hash of a common bus address.
    pub(super) shares_line: bool,
}

/// Result of a request to another gateway for its claim.
pub(super) enum Answer {
    Claim(Claim),
    /// The gateway has ended.
    Gone,
    /// The gateway sends no claim, or an invalid claim.
    Silent,
    /// The connection closed before the whole claim was received. The gateway is about to end.
    Cut,
    /// The operating system refuses the connection.
    Failed(io::Error),
}

/// Lists the other gateways that may use the same bus as this one.
pub(super) fn others(own: &Claim) -> io::Result<Vec<Other>> {
    let list = std::fs::read_to_string("/proc/net/unix")?;
    let (hashes, order) = (hashes(own), format!("-{:08x}", own.order));
    let is_other = |other: &Other| !other.name.contains(&order);
    Ok(list.lines().filter_map(|line| Other::listed(line, &hashes)).filter(is_other).collect())
}

impl Other {
    /// Parses a line of the kernel's list: `address: references protocol flags type state inode @name`. Returns
    /// `None` if the socket does not belong to a gateway, or if the gateway has none of these hashes.
    fn listed(line: &str, hashes: &BTreeSet<String>) -> Option<Other> {
        let flags = u32::from_str_radix(line.split(' ').nth(3)?, 16).ok()?;
        let (_, name) = line.split_once(" @")?;
        let (who, lines) = name.strip_prefix(PREFIX)?.split_once('/')?;
        let process = who.split_once('-')?.0.parse().ok()?;
        let is_shared = |hash: &[u8]| std::str::from_utf8(hash).is_ok_and(|hash| hashes.contains(hash));
        let shares_line = lines.as_bytes().chunks(HASH).any(is_shared);
        let may_share = shares_line || lines == MANY;
        (flags & ACCEPTS != 0 && may_share).then(|| Other { name: name.to_owned(), process, shares_line })
    }

    /// Asks the gateway for its claim.
    pub(super) fn ask(&self) -> Answer {
        match self.receive() {
            Ok(claim) => match serde_json::from_slice(&claim) {
                Ok(claim) => Answer::Claim(claim),
                Err(error) if error.is_eof() => Answer::Cut,
                Err(_) => Answer::Silent,
            },
            Err(error) => match error.kind() {
                io::ErrorKind::ConnectionRefused | io::ErrorKind::ConnectionReset => Answer::Gone,
                io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut => Answer::Silent,
                _ => Answer::Failed(error),
            },
        }
    }

    fn receive(&self) -> io::Result<Vec<u8>> {
        let socket = Socket::new(Domain::UNIX, Type::STREAM, None)?;
        // The queue of a suspended process can be full, and connecting would block.
        socket.set_nonblocking(true)?;
        socket.connect(&SockAddr::unix(format!("\0{}", self.name))?)?;
        socket.set_nonblocking(false)?;
        socket.set_read_timeout(Some(PATIENCE))?;
        let mut claim = Vec::new();
        socket.take(LARGEST).read_to_end(&mut claim)?;
        Ok(claim)
    }
}

/// Returns a hash of each canonical name of each bus in the claim.
fn hashes(claim: &Claim) -> BTreeSet<String> {
    // FNV: the same in every version.
    let hash = |name: &str| {
        name.bytes().fold(2_166_136_261_u32, |hash, byte| (hash ^ u32::from(byte)).wrapping_mul(16_777_619))
    };
    claim.names().into_iter().map(|name| format!("{:08x}", hash(name))).collect()
}

fn joined(hashes: &BTreeSet<String>) -> String {
    match hashes.len() {
        0..=MOST_HASHES => hashes.iter().map(String::as_str).collect(),
        _ => MANY.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gateway::claims::{Line, random};

    fn claim(order: u32, names: impl Iterator<Item = String>) -> Claim {
        let line = |name: String| Line { address: name.clone(), names: vec![name], places: BTreeSet::new() };
        let lines = names.map(line).collect();
        let (machine, state) = ("mill".to_owned(), "/srv".into());
        Claim { process: std::process::id(), order, machine, state, is_held: false, lines }
    }

    fn one(order: u32, name: &str) -> Claim {
        claim(order, std::iter::once(name.to_owned()))
    }

    #[test]
    fn a_gateway_that_ends_while_it_is_asked_is_no_rival() {
        let own = one(random(), &format!("tcp test:{}", random()));
        let name = format!("{PREFIX}{}-{:08x}/{}", own.process, own.order ^ 1, joined(&hashes(&own)));
        let listener = UnixListener::bind_addr(&SocketAddr::from_abstract_name(name).unwrap()).unwrap();
        let ends = std::thread::spawn(move || drop(listener.accept().unwrap()));
        assert_eq!(crate::gateway::claims::compare_with_others(&own, |_| false), Ok(None));
        ends.join().unwrap();
    }

    #[test]
    fn a_claim_is_found_by_gateways_that_share_a_line_and_says_whether_it_is_held() {
        let (order, line) = (random(), format!("tcp test:{}", random()));
        let listener = Listener::open(one(order, &line)).unwrap();
        let own = one(order ^ 1, &line);
        // Gateways of other tests may write to so many lines that one could be this.
        let here = |own: &Claim| {
            let mut others = others(own).unwrap();
            others.retain(|other| other.shares_line);
            others
        };
        for is_held in [false, true] {
            let others = here(&own);
            let [other] = &others[..] else { panic!("{} others", others.len()) };
            let Answer::Claim(found) = other.ask() else { panic!("no claim") };
            assert_eq!(found, Claim { is_held, ..one(order, &line) });
            listener.hold();
        }
        let elsewhere = one(order ^ 3, &format!("{line}0"));
        assert!(here(&elsewhere).is_empty());
        assert!(here(&one(order, &line)).is_empty(), "its own claim");
    }

    #[test]
    fn a_claim_of_many_lines_may_share_one_with_anybody_and_sees_those_with_few() {
        let (few, many, line) = (random(), random(), format!("tcp test:{}", random()));
        let lines = || (0..500).map(|place| format!("{line}{place}"));
        let _few = Listener::open(one(few, &format!("{line}499"))).unwrap();
        let _many = Listener::open(claim(many, lines())).unwrap();
        let found = |own: &Claim, order: u32| {
            let mut others = others(own).unwrap().into_iter();
            others.find(|other| other.name.contains(&format!("-{order:08x}/"))).map(|other| other.shares_line)
        };
        assert_eq!(found(&claim(many, lines()), few), Some(true));
        assert_eq!(found(&one(few, &line), many), Some(false), "to be asked");
    }

    #[test]
    fn a_name_has_room_for_its_hashes() {
        let nine = claim(u32::MAX, (0..9).map(|place| format!("tcp {place}")));
        let claim = Claim { process: 4_194_304, ..nine };
        assert_eq!(hashes(&claim).len(), 9);
        assert!(Listener::open(claim).is_ok());
    }

    #[test]
    fn a_gateway_that_has_ended_and_one_that_sends_nothing_are_distinguished() {
        let name = format!("{PREFIX}1-{:08x}/", random());
        let gone = Other { name: name.clone(), process: 1, shares_line: true };
        assert!(matches!(gone.ask(), Answer::Gone));
        let address = SocketAddr::from_abstract_name(&name).unwrap();
        let _silent = UnixListener::bind_addr(&address).unwrap();
        assert!(matches!(gone.ask(), Answer::Silent));
    }
}
