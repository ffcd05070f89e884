//! Detection of a server that closes each connection after one answer.
//!
//! An orderly close after each answer does not show another client, and the next connection needs no
//! back-off. The line closes each connection to such a server itself, as with `quirks.close_after_each`.
//! Otherwise the line would send each request on a connection that is already closed. A write that is only
//! permitted on the connection of an earlier read (`SendDeadline::OnConnection`) would then always fail.

use crate::fieldbus::wire::Ending;

/// Number of consecutive connections that the server must close after one answer each, before this counts as a habit of
/// the server.
const IN_A_ROW: u32 = 3;

/// Number of consecutive connections that the server closed in an orderly way after one answer each, up to the last
/// connection.
#[derive(Debug, Default)]
pub(super) struct ClosingHabit(u32);

impl ClosingHabit {
    /// Records the end of a connection on which `answers` complete answers have arrived. Returns whether the server
    /// closed the connection in an orderly way after a complete answer.
    pub(super) fn ended(&mut self, answers: u32, ending: Ending) -> bool {
        let is_orderly = ending == Ending::Closed && answers > 0;
        self.0 = if is_orderly && answers == 1 { self.0.saturating_add(1) } else { 0 };
        is_orderly
    }

    /// Records that the server does not accept a connection. This resets the count, because another server may answer
    /// afterwards.
    pub(super) fn refused(&mut self) {
        self.0 = 0;
    }

    /// Returns whether the server closes each connection after one answer.
    pub(super) fn is_after_each(&self) -> bool {
        self.0 >= IN_A_ROW
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn three_connections_in_a_row_that_are_closed_after_one_answer_are_a_habit_and_nothing_else_is() {
        for (ends, is_habit) in [
            (&[(1, Ending::Closed), (1, Ending::Closed)][..], false),
            (&[(1, Ending::Closed), (1, Ending::Closed), (1, Ending::Closed)], true),
            (&[(1, Ending::Closed), (2, Ending::Closed), (1, Ending::Closed)], false),
            (&[(1, Ending::Closed), (1, Ending::Lost), (1, Ending::Closed)], false),
            (&[(0, Ending::Closed), (0, Ending::Closed), (0, Ending::Closed)], false),
            (&[(1, Ending::Lost), (1, Ending::Lost), (1, Ending::Lost)], false),
        ] {
            let mut habit = ClosingHabit::default();
            for (answers, ending) in ends {
                let is_orderly = habit.ended(*answers, *ending);
                assert_eq!(is_orderly, *answers > 0 && *ending == Ending::Closed, "{ends:?}");
            }
            assert_eq!(habit.is_after_each(), is_habit, "{ends:?}");
            habit.refused();
            assert!(!habit.is_after_each());
        }
    }
}
