//! Tests of wrong replies to reads and writes. The next request gets a correct answer, so that only one reply is wrong.

use std::future::Future;
use std::sync::Arc;
use std::time::Duration;

use crate::wrong_replies::peer::Peer;
use crate::wrong_replies::question::{Kind, LIE};
use crate::wrong_replies::rig::{Case, Life, none_is_believed};
use crate::wrong_replies::table::{ANY, CHECKSUM, HEADER, READ, WRITE, WRITE_SEVERAL, Wrong};

pub(crate) fn life<F>(live: impl Fn(Peer) -> F + Send + Sync + 'static) -> Life
where
    F: Future<Output = std::io::Result<()>> + Send + 'static,
{
    Arc::new(move |peer| Box::pin(live(peer)))
}

/// Returns a case in which every second answer is wrong: to reads if `writes` is `None`, else to writes.
fn case(kind: Kind, writes: Option<u8>, wrong: &'static Wrong) -> Case {
    let life = life(move |mut peer: Peer| async move {
        loop {
            let asked = peer.asked().await?;
            let is_its_turn =
                asked.is_read() == writes.is_none() && !peer.lane.behaves() && peer.lane.is_next();
            if is_its_turn {
                let attempt = peer.lane.tries();
                let said = (wrong.made)(&asked, attempt);
                if said != asked.right() {
                    peer.say(&said).await?;
                    continue;
                }
                // The gateway also writes 0 if a write was unanswered for long. The value 0 is then the correct echo.
                peer.lane.voids();
            }
            peer.answer(&asked).await?;
        }
    });
    let name = match writes {
        None => wrong.name.to_owned(),
        Some(function) => format!("to function {function} {}", wrong.name),
    };
    Case { name, kind, writes, stands_still: None, life }
}

fn reads(kind: Kind) -> Vec<Case> {
    let own = if kind.is_rtu() { &CHECKSUM } else { &HEADER };
    ANY.iter().chain(own).chain(&READ).map(|wrong| case(kind, None, wrong)).collect()
}

fn writes(kind: Kind, function: u8) -> Vec<Case> {
    let own = if kind.is_rtu() { &CHECKSUM } else { &HEADER };
    let several: &[Wrong] = if function == 16 { &WRITE_SEVERAL } else { &[] };
    let all = ANY.iter().chain(own).chain(&WRITE).chain(several);
    all.map(|wrong| case(kind, Some(function), wrong)).collect()
}

#[test]
fn no_wrong_reply_to_a_read_over_tcp_is_ever_a_reading() {
    none_is_believed(reads(Kind::Tcp));
}

#[test]
fn no_wrong_reply_to_a_read_by_rtu_over_tcp_is_ever_a_reading() {
    none_is_believed(reads(Kind::RtuOverTcp));
}

#[test]
fn no_wrong_reply_to_a_read_on_a_serial_port_is_ever_a_reading() {
    none_is_believed(reads(Kind::Port));
}

#[test]
fn no_wrong_reply_to_a_write_of_one_register_is_ever_its_echo() {
    none_is_believed(writes(Kind::Tcp, 6));
}

#[test]
fn no_wrong_reply_to_a_write_of_several_registers_is_ever_their_echo() {
    none_is_believed(writes(Kind::Tcp, 16));
}

#[test]
fn no_wrong_reply_to_a_write_by_rtu_is_ever_its_echo() {
    none_is_believed(writes(Kind::RtuOverTcp, 6));
}

#[test]
fn no_wrong_reply_to_a_write_on_a_serial_port_is_ever_its_echo() {
    none_is_believed(writes(Kind::Port, 16));
}

/// Correct answers followed by more bytes. Those bytes answer no request. The answers may be accepted or not.
#[test]
fn what_comes_behind_a_right_answer_is_never_the_next_one() {
    let after = |kind: Kind, name: &str, lies: bool| {
        let life = life(move |mut peer: Peer| async move {
            loop {
                let asked = peer.asked().await?;
                if peer.lane.behaves() {
                    peer.answer(&asked).await?;
                    continue;
                }
                peer.lane.tries();
                peer.lane.is_answered(&asked);
                let next = asked.transaction.wrapping_add(1);
                let behind = if lies { kind.frame(next, asked.unit, &asked.pdu_of(LIE)) } else { vec![0x5a] };
                peer.say(&[asked.right(), behind].concat()).await?;
            }
        });
        Case { name: name.to_owned(), kind, writes: None, stands_still: None, life }
    };
    let each = Kind::ALL.into_iter();
    none_is_believed(
        each.flat_map(|kind| [after(kind, "a second answer", true), after(kind, "a stray byte", false)])
            .collect(),
    );
}

/// Counterpart: an answer in pieces is the same answer.
#[test]
fn right_answers_in_pieces_are_readings() {
    let pieces = |kind: Kind, name: &str, size: usize| {
        let life = life(move |mut peer: Peer| async move {
            loop {
                let asked = peer.asked().await?;
                peer.lane.tries();
                peer.lane.is_answered(&asked);
                for piece in asked.right().chunks(size) {
                    peer.say(piece).await?;
                    tokio::time::sleep(Duration::from_micros(300)).await;
                }
            }
        });
        Case { name: name.to_owned(), kind, writes: None, stands_still: None, life }
    };
    let each = Kind::ALL.into_iter();
    let cases = each.flat_map(|kind| {
        [pieces(kind, "byte by byte", 1), pieces(kind, "in threes", 3), pieces(kind, "whole", 300)]
    });
    none_is_believed(cases.collect());
}
