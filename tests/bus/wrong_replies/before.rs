//! Tests of replies that arrive before their request.

use std::time::Duration;

use crate::wrong_replies::peer::Peer;
use crate::wrong_replies::question::{Kind, LIE, reading};
use crate::wrong_replies::rig::{Case, Life, none_is_believed};
use crate::wrong_replies::wrong::life;

const READ_INPUT: u8 = 4;

fn case(kind: Kind, name: &str, life: Life) -> Case {
    Case { name: name.to_owned(), kind, writes: None, stands_still: None, life }
}

/// Returns a false reply to the request with this transaction.
fn lie(kind: Kind, transaction: u16) -> Vec<u8> {
    kind.frame(transaction, 1, &reading(READ_INPUT, LIE))
}

fn fifty(kind: Kind) -> Vec<u8> {
    (0..50).flat_map(|transaction| lie(kind, transaction)).collect()
}

/// Sends fifty false replies on connect. If `answers` is set, the device closes its first two connections soon, so that
/// further ones follow.
fn on_connect(kind: Kind, answers: bool) -> Life {
    life(move |mut peer: Peer| async move {
        if !peer.lane.behaves() {
            peer.lane.tries();
            peer.say(&fifty(kind)).await?;
        }
        for answered in 0.. {
            let asked = peer.asked().await?;
            if answers || peer.lane.behaves() {
                peer.answer(&asked).await?;
            }
            if answers && !peer.lane.behaves() && peer.connection < 2 && answered == 1 {
                break;
            }
        }
        Ok(())
    })
}

/// Sends fifty false replies on a port, whose opening a device cannot detect: before the first request, and before
/// later ones.
fn on_a_port(answers: bool) -> Life {
    life(move |mut peer: Peer| async move {
        loop {
            if !peer.lane.behaves() {
                peer.lies_before(&fifty(Kind::Port)).await?;
            }
            let asked = peer.asked().await?;
            if answers || peer.lane.behaves() {
                peer.answer(&asked).await?;
            } else {
                // Only after its timeout is the reply unsolicited.
                tokio::time::sleep(3 * Kind::Port.timeout()).await;
            }
        }
    })
}

#[test]
fn fifty_replies_on_connect_are_no_readings() {
    let each =
        [(true, "fifty on connect, then answers"), (false, "fifty on connect, then silence")].into_iter();
    let cases = each.flat_map(|(answers, name)| {
        Kind::ALL.map(|kind| match kind {
            Kind::Port => case(kind, name, on_a_port(answers)),
            _ => case(kind, name, on_connect(kind, answers)),
        })
    });
    none_is_believed(cases.collect());
}

/// Sends after each answer a reply to the next request, like a device that is ahead by one.
fn ahead(kind: Kind, pause: Duration) -> Life {
    life(move |mut peer: Peer| async move {
        loop {
            let asked = peer.asked().await?;
            peer.answer(&asked).await?;
            if !peer.lane.behaves() {
                tokio::time::sleep(pause).await;
                peer.lies_before(&lie(kind, asked.transaction.wrapping_add(1))).await?;
            }
        }
    })
}

#[test]
fn a_reply_that_was_there_before_its_question_is_no_reading() {
    let pauses = [("1 ms", 1), ("10 ms", 10), ("60 ms", 60)];
    let each = Kind::ALL.into_iter();
    let cases = each.flat_map(|kind| {
        pauses.map(|(pause, ms)| {
            let name = format!("ahead by one, {pause} after its answer");
            case(kind, &name, ahead(kind, Duration::from_millis(ms)))
        })
    });
    none_is_believed(cases.collect());
}

/// Sends a false reply every 5 ms, with or without a request, with the next transaction. Twenty-five of them are an
/// attempt, and so are fewer on a connection that is closed.
///
/// A serial line is then never silent for long enough to send a request. If a request arrives all the same, the
/// computer was too busy to send every 5 ms. The next reply may then count as an answer, and cannot be distinguished
/// from one. The device therefore behaves correctly until the gateway accepts it. Then the attempt is repeated, as
/// often as `Lane::spoils` allows.
fn pushes(kind: Kind, answers: bool) -> Life {
    life(move |mut peer: Peer| async move {
        let (mut next, mut pushed) = (0, 0);
        loop {
            let is_good = |peer: &Peer| peer.lane.behaves() || peer.lane.is_void();
            let pause = Duration::from_millis(if is_good(&peer) { 3_600_000 } else { 5 });
            tokio::select! {
                asked = peer.asked() => {
                    let asked = asked?;
                    next = asked.transaction.wrapping_add(1);
                    if kind.is_rtu() && !is_good(&peer) {
                        peer.lane.spoils();
                    }
                    if answers || is_good(&peer) {
                        peer.answer(&asked).await?;
                    }
                }
                () = tokio::time::sleep(pause) => {
                    // A reply after a request would answer it.
                    if peer.is_asked() {
                        continue;
                    }
                    if pushed % 25 == 0 {
                        peer.lane.tries();
                    }
                    pushed += 1;
                    peer.say(&lie(kind, next)).await?;
                    if kind.is_rtu() && peer.is_asked() {
                        peer.lane.spoils();
                    }
                }
            }
        }
    })
}

#[test]
fn replies_that_come_every_5_ms_whether_asked_or_not_are_no_readings() {
    let each = Kind::ALL.into_iter();
    let cases = each.flat_map(|kind| {
        let answers = case(kind, "every 5 ms, and answers", pushes(kind, true));
        [answers, case(kind, "every 5 ms, and no answer", pushes(kind, false))]
    });
    none_is_believed(cases.collect());
}
