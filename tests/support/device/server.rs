//! A Modbus server on a socket: whoever uses it says what becomes of each question, and of its connection.

use std::io::{Error, ErrorKind, Read, Result};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::time::Duration;

use isotherm_core::codec::checksum;

use crate::support::starved;

/// What was asked, and on which connection: they are numbered as they were accepted.
#[derive(Clone, Debug)]
pub(crate) struct Question {
    pub(crate) connection: usize,
    pub(crate) unit: u8,
    pub(crate) pdu: Vec<u8>,
    /// Of Modbus TCP; nothing of RTU.
    transaction: Option<[u8; 2]>,
    /// How long this thread waited for a processor before it took it.
    pub(crate) waited: Duration,
}

impl Question {
    fn word(&self, at: usize) -> u16 {
        u16::from_be_bytes([self.pdu[at], self.pdu[at + 1]])
    }

    pub(crate) fn is_read(&self) -> bool {
        self.pdu[0] == 3
    }

    /// Its first register.
    pub(crate) fn from(&self) -> u16 {
        self.word(1)
    }

    /// How many registers are read.
    pub(crate) fn count(&self) -> u16 {
        self.word(3)
    }

    /// What is to be written.
    pub(crate) fn words(&self) -> Vec<u16> {
        match self.pdu[0] {
            6 => vec![self.word(3)],
            _ => (0..usize::from(self.word(3))).map(|place| self.word(6 + 2 * place)).collect(),
        }
    }

    /// What a read of this bank is answered.
    pub(crate) fn read(&self, bank: &[u16]) -> Vec<u8> {
        let from = usize::from(self.from());
        let words = &bank[from..from + usize::from(self.count())];
        let mut pdu = vec![3, u8::try_from(2 * words.len()).unwrap()];
        pdu.extend(words.iter().flat_map(|word| word.to_be_bytes()));
        pdu
    }

    /// What a write that was carried out is answered.
    pub(crate) fn done(&self) -> Vec<u8> {
        self.pdu[..5].to_vec()
    }

    /// An exception.
    pub(crate) fn denied(&self, code: u8) -> Vec<u8> {
        vec![self.pdu[0] | 0x80, code]
    }

    /// This answer as it goes over the line.
    pub(crate) fn answer(&self, pdu: &[u8]) -> Vec<u8> {
        match self.transaction {
            Some(transaction) => {
                let length = u16::try_from(pdu.len() + 1).unwrap().to_be_bytes();
                [&transaction[..], &[0, 0], &length, &[self.unit], pdu].concat()
            }
            None => {
                let frame = [&[self.unit], pdu].concat();
                let check = checksum(&frame).to_le_bytes();
                [frame, check.to_vec()].concat()
            }
        }
    }

    /// The first question of RTU among these bytes, which it takes out of them; `None` where it has not come as a whole.
    pub(crate) fn of_rtu(bytes: &mut Vec<u8>, connection: usize) -> Option<Question> {
        let length = match *bytes.get(1)? {
            16 => 9 + usize::from(*bytes.get(6)?),
            _ => 8,
        };
        if bytes.len() < length {
            return None;
        }
        let frame: Vec<u8> = bytes.drain(..length).collect();
        let check = u16::from_le_bytes([frame[length - 2], frame[length - 1]]);
        assert_eq!(check, checksum(&frame[..length - 2]), "{frame:?}");
        let pdu = frame[1..length - 2].to_vec();
        Some(Question { connection, unit: frame[0], pdu, transaction: None, waited: Duration::ZERO })
    }
}

/// The connection is to end.
pub(crate) fn hang_up<T>() -> Result<T> {
    Err(Error::from(ErrorKind::ConnectionReset))
}

/// Answers whoever connects to this listener, until the process ends: `begins` hears of each connection, `answer` of each
/// question. An error of either ends the connection.
pub(crate) fn listen<B, A>(listener: TcpListener, begins: B, answer: A)
where
    B: Fn(usize) -> Result<()> + Clone + Send + 'static,
    A: Fn(&Question, &mut TcpStream) -> Result<()> + Clone + Send + 'static,
{
    std::thread::spawn(move || {
        for (connection, stream) in listener.incoming().enumerate() {
            let (begins, answer) = (begins.clone(), answer.clone());
            std::thread::spawn(move || converse(connection, stream?, &begins, &answer));
        }
    });
}

/// The same on a port of its own, for whom all connections are alike. It answers at 127.0.0.2 too: a gateway that reaches it there
/// stands for one on another computer.
pub(crate) fn serve<A>(answer: A) -> SocketAddr
where
    A: Fn(&Question, &mut TcpStream) -> Result<()> + Clone + Send + 'static,
{
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    if let Ok(elsewhere) = TcpListener::bind(("127.0.0.2", address.port())) {
        listen(elsewhere, |_| Ok(()), answer.clone());
    }
    listen(listener, |_| Ok(()), answer);
    address
}

fn converse(
    connection: usize,
    mut stream: TcpStream,
    begins: impl Fn(usize) -> Result<()>,
    answer: impl Fn(&Question, &mut TcpStream) -> Result<()>,
) -> Result<()> {
    stream.set_nodelay(true)?;
    begins(connection)?;
    loop {
        let before = starved::this_thread();
        let mut header = [0; 7];
        stream.read_exact(&mut header)?;
        let length = usize::from(u16::from_be_bytes([header[4], header[5]]));
        let mut pdu = vec![0; length - 1];
        stream.read_exact(&mut pdu)?;
        let transaction = Some([header[0], header[1]]);
        let waited = starved::this_thread().saturating_sub(before);
        answer(&Question { connection, unit: header[6], pdu, transaction, waited }, &mut stream)?;
    }
}
