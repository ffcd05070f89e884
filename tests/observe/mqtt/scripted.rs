//! Broker of MQTT 3.1.1 in this process. It records each packet in the order of the wire, and answers as a script says.

use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::{Arc, Mutex, MutexGuard};

/// Received packet.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Packet {
    /// CONNECT.
    Connect(Connect),
    /// SUBSCRIBE to one topic, with its quality of service.
    Subscribe(String, u8),
    /// PUBLISH to this topic.
    Publish(String),
}

/// Content of a CONNECT packet.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Connect {
    /// Flags: 2 is a clean session, 4 a will, 8 its quality of service 1, 32 its retain flag.
    pub(crate) flags: u8,
    /// Topic of the will; empty if there is none.
    pub(crate) topic: String,
    /// Content of the will.
    pub(crate) will: Vec<u8>,
}

/// Answers of the broker.
#[derive(Clone, Debug, Default)]
pub(crate) struct Script {
    /// Code of the answer to CONNECT; 0 accepts the gateway.
    pub(crate) connack: u8,
    /// Topics of which a subscription is refused (0x80).
    pub(crate) refuses: Vec<String>,
    /// Topics of which a message closes the connection.
    pub(crate) closes_on: Vec<String>,
}

#[derive(Default)]
struct State {
    script: Script,
    wire: Vec<Packet>,
    connections: Vec<TcpStream>,
}

/// Running broker.
pub(crate) struct Scripted {
    pub(crate) port: u16,
    state: Arc<Mutex<State>>,
}

impl Scripted {
    /// Starts the broker at this port; 0 for any.
    pub(crate) fn at(port: u16, script: Script) -> Scripted {
        let listener = TcpListener::bind(("127.0.0.1", port)).unwrap();
        let port = listener.local_addr().unwrap().port();
        let state = Arc::new(Mutex::new(State { script, ..State::default() }));
        let shared = state.clone();
        std::thread::spawn(move || {
            for stream in listener.incoming().flatten() {
                let state = shared.clone();
                // A connection ends with an error when the gateway or the script closes it.
                std::thread::spawn(move || serve(stream, &state).unwrap_or_default());
            }
        });
        Scripted { port, state }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap()
    }

    /// Changes the answers from now on.
    pub(crate) fn now(&self, script: Script) {
        self.state().script = script;
    }

    /// Closes all connections.
    pub(crate) fn breaks(&self) {
        for stream in self.state().connections.drain(..) {
            let _ = stream.shutdown(std::net::Shutdown::Both);
        }
    }

    /// Packets so far.
    pub(crate) fn wire(&self) -> Vec<Packet> {
        self.state().wire.clone()
    }

    /// CONNECT packets so far.
    pub(crate) fn connects(&self) -> Vec<Connect> {
        let connect =
            |packet: Packet| if let Packet::Connect(connect) = packet { Some(connect) } else { None };
        self.wire().into_iter().filter_map(connect).collect()
    }

    /// Number of messages to this topic so far.
    pub(crate) fn published(&self, topic: &str) -> usize {
        self.wire().iter().filter(|packet| **packet == Packet::Publish(topic.to_owned())).count()
    }
}

fn serve(mut stream: TcpStream, state: &Mutex<State>) -> std::io::Result<()> {
    state.lock().unwrap().connections.push(stream.try_clone()?);
    loop {
        let (first, body) = packet(&mut stream)?;
        let mut state = state.lock().unwrap();
        let script = state.script.clone();
        match first >> 4 {
            1 => {
                state.wire.push(Packet::Connect(Connect::of(&body)));
                stream.write_all(&[0x20, 2, 0, script.connack])?;
                if script.connack != 0 {
                    return stream.shutdown(std::net::Shutdown::Both);
                }
            }
            3 => {
                let topic = text(&body, 0);
                state.wire.push(Packet::Publish(topic.clone()));
                if script.closes_on.contains(&topic) {
                    return stream.shutdown(std::net::Shutdown::Both);
                }
                if first & 0b110 != 0 {
                    let id = 2 + topic.len();
                    stream.write_all(&[0x40, 2, body[id], body[id + 1]])?;
                }
            }
            8 => {
                let topic = text(&body, 2);
                let qos = body[body.len() - 1];
                let code = if script.refuses.contains(&topic) { 0x80 } else { qos };
                state.wire.push(Packet::Subscribe(topic, qos));
                stream.write_all(&[0x90, 3, body[0], body[1], code])?;
            }
            10 => stream.write_all(&[0xb0, 2, body[0], body[1]])?,
            12 => stream.write_all(&[0xd0, 0])?,
            _ => {}
        }
    }
}

impl Connect {
    fn of(body: &[u8]) -> Connect {
        // Name of the protocol, its level, flags and keep-alive, then the client's name.
        let flags = body[7];
        if flags & 4 == 0 {
            return Connect { flags, topic: String::new(), will: Vec::new() };
        }
        let place = 10 + 2 + text(body, 10).len();
        let topic = text(body, place);
        let will = bytes(body, place + 2 + topic.len()).to_vec();
        Connect { flags, topic, will }
    }
}

/// Bytes at this place, with their length before them.
fn bytes(body: &[u8], place: usize) -> &[u8] {
    let length = usize::from(u16::from_be_bytes([body[place], body[place + 1]]));
    &body[place + 2..place + 2 + length]
}

fn text(body: &[u8], place: usize) -> String {
    String::from_utf8(bytes(body, place).to_vec()).unwrap()
}

/// Reads a packet: its first byte and its content.
fn packet(stream: &mut TcpStream) -> std::io::Result<(u8, Vec<u8>)> {
    let mut byte = [0];
    stream.read_exact(&mut byte)?;
    let (first, mut length, mut shift) = (byte[0], 0_usize, 0);
    loop {
        stream.read_exact(&mut byte)?;
        length |= usize::from(byte[0] & 0x7f) << shift;
        shift += 7;
        if byte[0] < 0x80 {
            break;
        }
    }
    let mut body = vec![0; length];
    stream.read_exact(&mut body)?;
    Ok((first, body))
}
