//! Places of an exchange, at one of which a device waits until it may go on.

use std::sync::{Condvar, Mutex, MutexGuard};
use std::time::Duration;

/// Where in which exchange.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Place(pub(crate) Of, pub(crate) At);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Of {
    /// It is accepted, and nothing has been asked on it.
    Connection,
    Temperature,
    /// The read of the offset before a write.
    Look,
    Write,
    /// The read of the offset after a write.
    ReadBack,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum At {
    /// The question has come, and nothing is done yet.
    Come,
    /// It is done, and nothing is answered yet.
    CarriedOut,
    /// Half of the answer's bytes are sent.
    Half,
    /// All of them are.
    Answered,
}

/// Open, until it is closed at one place.
#[derive(Debug, Default)]
pub(crate) struct Gate {
    state: Mutex<State>,
    changed: Condvar,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum State {
    #[default]
    Open,
    Closed(Place),
    /// Somebody waits there; all others pass.
    Reached,
}

impl Gate {
    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap()
    }

    /// The next who comes to this place waits there.
    pub(crate) fn close(&self, place: Place) {
        *self.state() = State::Closed(place);
    }

    pub(crate) fn is_closed_at(&self, place: Place) -> bool {
        *self.state() == State::Closed(place)
    }

    /// Waits until somebody waits there; whether somebody does.
    pub(crate) fn is_reached(&self, most: Duration) -> bool {
        let state = self.state();
        let waits = |state: &mut State| *state != State::Reached;
        *self.changed.wait_timeout_while(state, most, waits).unwrap().0 == State::Reached
    }

    /// Whoever waits goes on.
    pub(crate) fn open(&self) {
        *self.state() = State::Open;
        self.changed.notify_all();
    }

    pub(super) fn passes(&self, place: Place) {
        let mut state = self.state();
        if *state != State::Closed(place) {
            return;
        }
        *state = State::Reached;
        self.changed.notify_all();
        drop(self.changed.wait_while(state, |state| *state == State::Reached).unwrap());
    }
}
