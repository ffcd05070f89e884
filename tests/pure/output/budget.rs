//! Events that may still happen in the model around one output.

/// Number of times that each event may still happen.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) struct Budget {
    pub(crate) holds: u8,
    pub(crate) losses: u8,
    pub(crate) refusals: u8,
    pub(crate) ignored: u8,
    pub(crate) edits: u8,
    pub(crate) restarts: u8,
    pub(crate) kills: u8,
    pub(crate) pauses: u8,
    pub(crate) disk: u8,
    pub(crate) stale: u8,
    pub(crate) offs: u8,
    pub(crate) targets: u8,
    /// The output is in one request with others, which is sent in between.
    pub(crate) beats: u8,
    /// The interlock opens and closes again.
    pub(crate) interlocks: u8,
    /// The line is so late that the last moment of a write has passed.
    pub(crate) late: u8,
    /// The control applies a value later than the register holds it.
    pub(crate) lags: u8,
    /// Whether the decision approaches the target by one step per second, like the guard of an axis. Otherwise the
    /// decision is the target.
    pub(crate) has_guard: bool,
}

impl Budget {
    /// No faults or edits.
    pub(crate) const NONE: Budget = Budget {
        holds: 0,
        losses: 0,
        refusals: 0,
        ignored: 0,
        edits: 0,
        restarts: 0,
        kills: 0,
        pauses: 0,
        disk: 0,
        stale: 0,
        offs: 0,
        targets: 0,
        beats: 0,
        interlocks: 0,
        late: 0,
        lags: 0,
        has_guard: false,
    };

    /// Every event once.
    pub(crate) const ALL: Budget = Budget {
        holds: 1,
        losses: 1,
        refusals: 1,
        ignored: 1,
        edits: 1,
        restarts: 1,
        kills: 1,
        pauses: 1,
        disk: 1,
        stale: 1,
        offs: 1,
        targets: 1,
        beats: 0,
        interlocks: 1,
        late: 1,
        lags: 0,
        has_guard: true,
    };

    /// Returns whether no event is left.
    pub(crate) fn is_spent(self) -> bool {
        self == Budget { has_guard: self.has_guard, ..Budget::NONE }
    }
}
