//! Places in an exchange at which a device can be made to wait.

use std::sync::{Condvar, Mutex, MutexGuard};
use std::time::Duration;

/// Place in an exchange.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Place(pub(crate) Of, pub(crate) At);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Of {
    /// The connection was accepted, and nothing was requested on it.
    Connection,
    Temperature,
    /// Read of the offset before a write.
    Look,
    Write,
    /// Read of the offset after a write.
    ReadBack,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum At {
    /// The request has arrived, and nothing was done.
    Come,
    /// The request was executed, and nothing was answered.
    CarriedOut,
    /// Half of the bytes of the answer were sent.
    Half,
    /// The whole answer was sent.
    Answered,
}

/// Gate that is open until it is closed at one place.
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
    /// A thread waits there; all others pass.
    Reached,
}

impl Gate {
    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap()
    }

    /// Makes the next thread that reaches this place wait there.
    pub(crate) fn close(&self, place: Place) {
        *self.state() = State::Closed(place);
    }

    pub(crate) fn is_closed_at(&self, place: Place) -> bool {
        *self.state() == State::Closed(place)
    }

    /// Waits until a thread waits there. Returns whether one does.
    pub(crate) fn is_reached(&self, most: Duration) -> bool {
        let state = self.state();
        let waits = |state: &mut State| *state != State::Reached;
        *self.changed.wait_timeout_while(state, most, waits).unwrap().0 == State::Reached
    }

    /// Lets the waiting thread continue.
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
