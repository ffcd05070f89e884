//! Table of wrong replies with their names.

use rand::{Rng, SeedableRng};
use rand_pcg::Pcg32;

use crate::wrong_replies::question::{Question, rtu, tcp};

/// Kind of wrong reply, and how to make it. The number of the attempt makes each reply different.
pub(crate) struct Wrong {
    pub(crate) name: &'static str,
    pub(crate) made: fn(&Question, u32) -> Vec<u8>,
}

const fn wrong(name: &'static str, made: fn(&Question, u32) -> Vec<u8>) -> Wrong {
    Wrong { name, made }
}

/// Returns the answer with a change in its content, in a correct frame.
fn changed(asked: &Question, change: impl FnOnce(&mut Vec<u8>)) -> Vec<u8> {
    let mut pdu = asked.content();
    change(&mut pdu);
    asked.framed(&pdu)
}

/// Returns the answer in a header with this transaction, protocol and length.
fn headed(asked: &Question, transaction: u16, protocol: u16, length: usize) -> Vec<u8> {
    tcp(transaction, protocol, length, asked.unit, &asked.content())
}

fn whole(asked: &Question) -> Vec<u8> {
    asked.framed(&asked.content())
}

fn length(asked: &Question) -> usize {
    asked.content().len() + 1
}

/// Wrong replies for every line and request.
pub(crate) const ANY: [Wrong; 21] = [
    wrong("another unit", |asked, _| asked.framed_for(2)),
    wrong("unit 0", |asked, _| asked.framed_for(0)),
    wrong("unit 255", |asked, _| asked.framed_for(255)),
    wrong("the function beside it", |asked, _| {
        changed(asked, |pdu| pdu[0] = if pdu[0] == 4 { 3 } else { 5 })
    }),
    wrong("a function that there is not", |asked, _| changed(asked, |pdu| pdu[0] = 0x55)),
    wrong("the bit of an exception on a right answer", |asked, _| changed(asked, |pdu| pdu[0] |= 0x80)),
    wrong("an exception without a code", |asked, _| asked.framed(&[asked.function() | 0x80])),
    wrong("an exception of three bytes", |asked, _| asked.framed(&[asked.function() | 0x80, 2, 0])),
    wrong("an exception of another function", |asked, _| asked.framed(&[0x81, 2])),
    wrong("a byte too few", |asked, _| changed(asked, |pdu| pdu.truncate(pdu.len() - 1))),
    wrong("a byte too many", |asked, _| changed(asked, |pdu| pdu.push(0))),
    wrong("the function and nothing else", |asked, _| asked.framed(&[asked.function()])),
    wrong("the last byte cut off", |asked, _| whole(asked).split_last().unwrap().1.to_vec()),
    wrong("half of it, then silence", |asked, _| {
        let bytes = whole(asked);
        bytes[..bytes.len() / 2].to_vec()
    }),
    wrong("the first byte alone", |asked, _| whole(asked)[..1].to_vec()),
    wrong("a byte before it", |asked, _| {
        // On an RTU line the byte is noise, so that the checksum must be wrong as well.
        let mut bytes = [&[0x03], whole(asked).as_slice()].concat();
        *bytes.last_mut().unwrap() ^= u8::from(asked.kind.is_rtu());
        bytes
    }),
    wrong("nothing but zeros", |asked, _| vec![0; whole(asked).len()]),
    wrong("nothing but ones", |asked, _| vec![0xff; whole(asked).len()]),
    wrong("random bytes", |asked, seed| {
        let mut bytes = vec![0; whole(asked).len()];
        Pcg32::seed_from_u64(u64::from(seed)).fill_bytes(&mut bytes);
        bytes
    }),
    wrong("text", |_, _| b"HTTP/1.1 400 Bad Request\r\nConnection: close\r\n\r\n".to_vec()),
    wrong("the frame of the other kind of line", |asked, _| {
        if asked.kind.is_rtu() {
            headed(asked, 1, 0, length(asked))
        } else {
            rtu(asked.unit, &asked.content())
        }
    }),
];

/// Wrong headers, which only TCP has.
pub(crate) const HEADER: [Wrong; 11] = [
    wrong("the transaction after it", |asked, _| {
        headed(asked, asked.transaction.wrapping_add(1), 0, length(asked))
    }),
    wrong("the transaction before it", |asked, _| {
        headed(asked, asked.transaction.wrapping_sub(1), 0, length(asked))
    }),
    wrong("a far transaction", |asked, seed| {
        let far = u16::try_from(seed % 0x4000).unwrap() + 0x4000;
        headed(asked, asked.transaction.wrapping_add(far), 0, length(asked))
    }),
    wrong("protocol 1", |asked, _| headed(asked, asked.transaction, 1, length(asked))),
    wrong("protocol 65535", |asked, _| headed(asked, asked.transaction, 0xffff, length(asked))),
    wrong("a length too short by 1", |asked, _| headed(asked, asked.transaction, 0, length(asked) - 1)),
    wrong("a length too short by 2", |asked, _| headed(asked, asked.transaction, 0, length(asked) - 2)),
    wrong("a length too long by 1", |asked, _| headed(asked, asked.transaction, 0, length(asked) + 1)),
    wrong("the length 0", |asked, _| headed(asked, asked.transaction, 0, 0)),
    wrong("the length 1", |asked, _| headed(asked, asked.transaction, 0, 1)),
    wrong("the length 65535", |asked, _| headed(asked, asked.transaction, 0, 0xffff)),
];

/// Wrong checksums, which only RTU has.
pub(crate) const CHECKSUM: [Wrong; 11] = [
    wrong("a bit of the checksum wrong", |asked, seed| flipped(asked, 1, seed)),
    wrong("a bit of the other half of the checksum wrong", |asked, seed| flipped(asked, 2, seed)),
    wrong("a bit of the last byte wrong", |asked, seed| flipped(asked, 3, seed)),
    wrong("a bit of the byte before it wrong", |asked, seed| flipped(asked, 4, seed)),
    wrong("a bit of the unit wrong", |asked, seed| {
        let mut bytes = whole(asked);
        bytes[0] ^= 1 << (seed % 8);
        bytes
    }),
    wrong("the checksum the wrong way round", |asked, _| {
        let mut bytes = whole(asked);
        let end = bytes.len() - 2;
        bytes[end..].reverse();
        bytes
    }),
    wrong("no checksum", |asked, _| whole(asked)[..asked.content().len() + 1].to_vec()),
    wrong("the checksum 0", |asked, _| [&[asked.unit], asked.content().as_slice(), &[0, 0]].concat()),
    wrong("the checksum of the answer without its unit", |asked, _| {
        let content = asked.content();
        let without = rtu(content[0], &content[1..]);
        [&[asked.unit], without.as_slice()].concat()
    }),
    wrong("a byte lost in the middle", |asked, _| {
        let mut bytes = whole(asked);
        bytes.remove(3);
        bytes
    }),
    wrong("a byte doubled in the middle", |asked, _| {
        let mut bytes = whole(asked);
        bytes.insert(4, bytes[4] ^ 0x10);
        bytes
    }),
];

fn flipped(asked: &Question, from_end: usize, seed: u32) -> Vec<u8> {
    let mut bytes = whole(asked);
    let place = bytes.len() - from_end;
    bytes[place] ^= 1 << (seed % 8);
    bytes
}

/// Wrong replies to a read.
pub(crate) const READ: [Wrong; 10] = [
    wrong("a count of bytes too small", |asked, _| changed(asked, |pdu| pdu[1] = 2)),
    wrong("a count of bytes too large", |asked, _| changed(asked, |pdu| pdu[1] = 6)),
    wrong("an odd count of bytes", |asked, _| changed(asked, |pdu| pdu[1] = 3)),
    wrong("an odd number of bytes", |asked, _| {
        changed(asked, |pdu| {
            pdu[1] = 3;
            pdu.pop();
        })
    }),
    wrong("a count of bytes of 0", |asked, _| changed(asked, |pdu| pdu[1] = 0)),
    wrong("a count of bytes of 255", |asked, _| changed(asked, |pdu| pdu[1] = 255)),
    wrong("no register at all", |asked, _| asked.framed(&[asked.function(), 0])),
    wrong("a register too few", |asked, _| {
        changed(asked, |pdu| {
            pdu[1] = 2;
            pdu.truncate(4);
        })
    }),
    wrong("a register too many", |asked, _| {
        changed(asked, |pdu| {
            pdu[1] = 6;
            pdu.extend([3, 9]);
        })
    }),
    wrong("the question back", |asked, _| asked.framed(&asked.pdu)),
];

/// Wrong replies to a write.
pub(crate) const WRITE: [Wrong; 10] = [
    wrong("the address after it", |asked, _| changed(asked, |pdu| pdu[2] += 1)),
    wrong("the address 0", |asked, _| changed(asked, |pdu| pdu[1..3].fill(0))),
    wrong("another value, or count", |asked, _| changed(asked, |pdu| pdu[4] ^= 1)),
    wrong("a high byte of another value, or count", |asked, _| changed(asked, |pdu| pdu[3] ^= 0x80)),
    wrong("the value, or count, 0", |asked, _| changed(asked, |pdu| pdu[3..5].fill(0))),
    wrong("address and value, or count, the wrong way round", |asked, _| {
        changed(asked, |pdu| pdu[1..5].rotate_left(2))
    }),
    wrong("the answer of the other way to write", |asked, _| changed(asked, |pdu| pdu[0] = 22 - pdu[0])),
    wrong("the answer to a read", |asked, _| asked.framed(&[4, 2, 0, 0])),
    wrong("the address alone", |asked, _| changed(asked, |pdu| pdu.truncate(3))),
    wrong("twice the content", |asked, _| changed(asked, |pdu| pdu.extend_from_within(1..))),
];

/// Wrong reply to a write of several registers. For a write of one, it would be correct.
pub(crate) const WRITE_SEVERAL: [Wrong; 1] =
    [wrong("the question back", |asked, _| asked.framed(&asked.pdu))];
