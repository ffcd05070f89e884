//! Direct requests to the component, without the gateway.

use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::Duration;

/// Indexes of the words in the block.
pub(crate) const HEARTBEAT: usize = 0;
pub(crate) const CONTROL: usize = 1;
const SEQUENCE: usize = 3;
const Z: usize = 8;
const COMPLEMENT: usize = 10;

/// Sends the bytes of a request, and returns those of its reply.
fn ask(port: u16, pdu: &[u8]) -> Vec<u8> {
    let mut stream = TcpStream::connect(("127.0.0.1", port)).unwrap();
    stream.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
    let length = u16::try_from(pdu.len() + 1).unwrap().to_be_bytes();
    stream.write_all(&[&[0, 7, 0, 0][..], &length, &[1], pdu].concat()).unwrap();
    let mut header = [0; 7];
    stream.read_exact(&mut header).unwrap();
    let mut answer = vec![0; usize::from(u16::from_be_bytes([header[4], header[5]])) - 1];
    stream.read_exact(&mut answer).unwrap();
    answer
}

fn read(port: u16, function: u8, from: u8, count: u8) -> Vec<u16> {
    let answer = ask(port, &[function, 0, from, 0, count]);
    assert_eq!(answer[0], function, "{answer:?}");
    answer[2..].chunks(2).map(|two| u16::from_be_bytes([two[0], two[1]])).collect()
}

/// Last accepted block of the gateway.
pub(crate) fn block(port: u16) -> Vec<u16> {
    read(port, 3, 0, 11)
}

/// Number of the last accepted block.
pub(crate) fn sequence(port: u16) -> u16 {
    block(port)[SEQUENCE]
}

/// Number of rejected writes.
pub(crate) fn refused(port: u16) -> u16 {
    read(port, 4, 27, 1)[0]
}

/// Counts of Z in a block, in units of 0.1 µm.
pub(crate) fn z(block: &[u16]) -> i32 {
    let [high, low] = [block[Z], block[Z + 1]].map(u16::to_be_bytes);
    i32::from_be_bytes([high[0], high[1], low[0], low[1]])
}

/// Writes a whole block as another client, with the next number and a correct check word.
pub(crate) fn writes(port: u16, counts: i32) -> Vec<u8> {
    let mut block = block(port);
    let [high_1, high_0, low_1, low_0] = counts.to_be_bytes();
    (block[Z], block[Z + 1]) = (u16::from_be_bytes([high_1, high_0]), u16::from_be_bytes([low_1, low_0]));
    block[SEQUENCE] = block[SEQUENCE].checked_add(1).unwrap_or(1);
    block[COMPLEMENT] = !block[..COMPLEMENT].iter().fold(0u16, |sum, word| sum.wrapping_add(*word));
    let words: Vec<u8> = block.iter().flat_map(|word| word.to_be_bytes()).collect();
    ask(port, &[&[16, 0, 0, 0, 11, 22][..], &words].concat())
}
