//! Modbus server on a socket. The caller decides about each request and each connection.

use std::io::{Error, ErrorKind, Read, Result};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::time::Duration;

use isotherm_core::codec::checksum;

use crate::support::starved;

/// Request, with the number of its connection in the order of acceptance.
#[derive(Clone, Debug)]
pub(crate) struct Question {
    pub(crate) connection: usize,
    pub(crate) unit: u8,
    pub(crate) pdu: Vec<u8>,
    /// Transaction of Modbus TCP. `None` for RTU.
    transaction: Option<[u8; 2]>,
    /// Time for which this thread waited for a processor before it took the request.
    pub(crate) waited: Duration,
}

impl Question {
    fn word(&self, at: usize) -> u16 {
        u16::from_be_bytes([self.pdu[at], self.pdu[at + 1]])
    }

    pub(crate) fn is_read(&self) -> bool {
        self.pdu[0] == 3
    }

    /// First register of the request.
    pub(crate) fn from(&self) -> u16 {
        self.word(1)
    }

    /// Number of registers of a read.
    pub(crate) fn count(&self) -> u16 {
        self.word(3)
    }

    /// Values of a write.
    pub(crate) fn words(&self) -> Vec<u16> {
        match self.pdu[0] {
            6 => vec![self.word(3)],
            _ => (0..usize::from(self.word(3))).map(|place| self.word(6 + 2 * place)).collect(),
        }
    }

    /// Answer to a read of these registers.
    pub(crate) fn read(&self, bank: &[u16]) -> Vec<u8> {
        let from = usize::from(self.from());
        let words = &bank[from..from + usize::from(self.count())];
        let mut pdu = vec![3, u8::try_from(2 * words.len()).unwrap()];
        pdu.extend(words.iter().flat_map(|word| word.to_be_bytes()));
        pdu
    }

    /// Answer to a write that was executed.
    pub(crate) fn done(&self) -> Vec<u8> {
        self.pdu[..5].to_vec()
    }

    /// Exception with this code.
    pub(crate) fn denied(&self, code: u8) -> Vec<u8> {
        vec![self.pdu[0] | 0x80, code]
    }

    /// Frame of this answer on the line.
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

    /// Takes the first RTU request out of these bytes. Returns `None` if it is not complete.
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

/// Error that ends the connection.
pub(crate) fn hang_up<T>() -> Result<T> {
    Err(Error::from(ErrorKind::ConnectionReset))
}

/// Serves all clients of this listener until the process ends. `begins` is called for each connection, `answer` for
/// each request. An error of either ends the connection.
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

/// Serves all connections alike, on a separate port. It also answers at 127.0.0.2: a gateway that reaches it there
/// represents one on another computer.
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
