//! A client that sends and receives raw bytes.

use std::net::SocketAddr;
use std::time::Duration;

use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;

/// Wall-clock time after which no answer is expected any more.
const PATIENCE: Duration = Duration::from_millis(150);

pub(super) struct Client {
    stream: TcpStream,
    pub(super) transaction: u16,
}

/// Result of a request.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Answer {
    Frame { transaction: u16, unit: u8, pdu: Vec<u8> },
    Silence,
    Closed,
}

impl Client {
    pub(super) async fn connect(address: SocketAddr) -> Client {
        Client { stream: TcpStream::connect(address).await.unwrap(), transaction: 0 }
    }

    pub(super) async fn send(&mut self, bytes: &[u8]) {
        self.stream.write_all(bytes).await.unwrap();
    }

    pub(super) async fn request(&mut self, unit: u8, pdu: &[u8]) -> Answer {
        self.transaction += 1;
        let frame = super::super::modbus::Framing::Tcp.frame(self.transaction, unit, pdu);
        self.send(&frame).await;
        self.receive().await
    }

    pub(super) async fn receive(&mut self) -> Answer {
        let mut header = [0; 7];
        match tokio::time::timeout(PATIENCE, self.stream.read_exact(&mut header)).await {
            Err(_) => return Answer::Silence,
            Ok(Err(_)) => return Answer::Closed,
            Ok(Ok(_)) => {}
        }
        let mut pdu = vec![0; usize::from(u16::from_be_bytes([header[4], header[5]])) - 1];
        self.stream.read_exact(&mut pdu).await.unwrap();
        Answer::Frame { transaction: u16::from_be_bytes([header[0], header[1]]), unit: header[6], pdu }
    }

    /// Received bytes, without interpretation.
    pub(super) async fn raw(&mut self) -> Vec<u8> {
        let mut bytes = vec![0; 300];
        let count = tokio::time::timeout(PATIENCE, self.stream.read(&mut bytes)).await.unwrap().unwrap();
        bytes.truncate(count);
        bytes
    }

    /// Protocol data unit of a normal answer.
    pub(super) async fn ask(&mut self, unit: u8, pdu: &[u8]) -> Vec<u8> {
        match self.request(unit, pdu).await {
            Answer::Frame { transaction, unit: from, pdu } => {
                assert_eq!((transaction, from), (self.transaction, unit));
                pdu
            }
            other => panic!("{other:?}"),
        }
    }

    /// Reads registers with function 03 or 04.
    pub(super) async fn read(&mut self, unit: u8, function: u8, from: u16, count: u16) -> Vec<u16> {
        let [[a, b], [c, d]] = [from.to_be_bytes(), count.to_be_bytes()];
        let pdu = self.ask(unit, &[function, a, b, c, d]).await;
        assert_eq!((pdu[0], usize::from(pdu[1])), (function, 2 * usize::from(count)), "{pdu:?}");
        pdu[2..].chunks(2).map(|pair| u16::from_be_bytes([pair[0], pair[1]])).collect()
    }

    /// Writes an i32 with function 16, most significant word first.
    pub(super) async fn write(&mut self, unit: u8, at: u16, value: i32) -> Vec<u8> {
        let ([a, b], [w, x, y, z]) = (at.to_be_bytes(), value.to_be_bytes());
        self.ask(unit, &[16, a, b, 0, 2, 4, w, x, y, z]).await
    }
}
