//! Tests of answers after their timeout, each with a different temperature.

use std::time::{Duration, Instant};

use crate::wrong_replies::peer::Peer;
use crate::wrong_replies::question::Kind;
use crate::wrong_replies::rig::{Case, Life, none_is_believed};
use crate::wrong_replies::wrong::life;

/// Latest time of a late answer. A unit without an answer gets no request for 750 ms plus its timeout. An even later
/// answer cannot be distinguished from the next one. If a busy computer delays the device that much, it sends no
/// answer.
const WAITED_FOR: Duration = Duration::from_millis(600);

/// Returns a temperature of 70 °C or more, different for each attempt.
fn own(attempt: u32) -> i32 {
    700 + i32::try_from(attempt).unwrap()
}

/// Delays every second answer to reads, or to writes, by `factor` timeouts.
fn late(factor: f64, writes: bool) -> Life {
    life(move |mut peer: Peer| async move {
        loop {
            let asked = peer.asked().await?;
            if asked.is_read() != writes && !peer.lane.behaves() && peer.lane.is_next() {
                let (attempt, begun) = (peer.lane.tries(), Instant::now());
                tokio::time::sleep(peer.kind().timeout().mul_f64(factor)).await;
                if begun.elapsed() < WAITED_FOR {
                    peer.say(&asked.framed(&asked.pdu_of(own(attempt)))).await?;
                    // The computer has stopped this task between the check and the answer.
                    if begun.elapsed() >= WAITED_FOR {
                        peer.lane.spoils();
                    }
                }
            } else {
                peer.answer(&asked).await?;
            }
        }
    })
}

const FACTORS: [f64; 4] = [1.2, 2.0, 3.0, 5.0];

#[test]
fn an_answer_after_its_timeout_is_no_reading() {
    let each = Kind::ALL.into_iter().flat_map(|kind| FACTORS.map(|factor| (kind, factor)));
    let case = |(kind, factor)| Case {
        name: format!("after {factor} timeouts"),
        kind,
        writes: None,
        stands_still: None,
        life: late(factor, false),
    };
    none_is_believed(each.map(case).collect());
}

#[test]
fn an_echo_after_its_timeout_is_none() {
    let each = Kind::ALL.into_iter().flat_map(|kind| FACTORS.map(|factor| (kind, factor)));
    let case = |(kind, factor)| Case {
        name: format!("of a write, after {factor} timeouts"),
        kind,
        writes: Some(16),
        stands_still: None,
        life: late(factor, true),
    };
    none_is_believed(each.map(case).collect());
}

/// The gateway's computer stops while the answer arrives. The gateway finds it after the stop, and it is still late.
#[test]
fn an_answer_that_is_found_after_its_timeout_is_no_reading() {
    let each = Kind::ALL.into_iter().flat_map(|kind| [1.2, 2.0].map(|factor| (kind, factor)));
    let case = |(kind, factor): (Kind, f64)| {
        let life = life(move |mut peer: Peer| async move {
            loop {
                let asked = peer.asked().await?;
                if peer.lane.behaves() {
                    peer.answer(&asked).await?;
                    continue;
                }
                let attempt = peer.lane.tries();
                tokio::time::sleep(peer.kind().timeout().mul_f64(factor)).await;
                peer.say(&asked.framed(&asked.pdu_of(own(attempt)))).await?;
            }
        });
        let name = format!("after {factor} timeouts, found when a computer goes on that stood still");
        Case { name, kind, writes: None, stands_still: Some(4 * kind.timeout()), life }
    };
    none_is_believed(each.map(case).collect());
}

/// Simulates a converter that forwards received bytes to any client. The answer to a request of the previous connection
/// arrives right after the first request of this one, with the transaction that it had. The converter closes the first
/// connection, because the gateway keeps a connection after a timeout.
#[test]
fn an_answer_to_a_question_of_the_connection_before_is_no_reading() {
    let life = life(move |mut peer: Peer| async move {
        let mut first = true;
        loop {
            let asked = peer.asked().await?;
            if peer.lane.behaves() {
                peer.answer(&asked).await?;
            } else if let Some(owed) = peer.lane.take_owed().filter(|_| first) {
                peer.lane.tries();
                peer.say(&owed).await?;
                peer.answer(&asked).await?;
            } else {
                let lie = asked.framed(&asked.content());
                peer.lane.owes(lie);
                tokio::time::sleep(2 * peer.kind().timeout()).await;
                return Ok(());
            }
            first = false;
        }
    });
    let name = "of the connection before".to_owned();
    none_is_believed(vec![Case { name, kind: Kind::Tcp, writes: None, stands_still: None, life }]);
}
