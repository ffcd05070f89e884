//! State that the tasks of the gateway share: its lock, the access of a bus line to it, and the calculations that run
//! while it is locked.

pub(super) mod carry_out;
pub(super) mod learning;
pub(super) mod line_handle;
pub(super) mod lock;
pub(super) mod namespaces;
pub(super) mod rates;
pub(super) mod releasing;
pub(super) mod shared_state;
pub(super) mod signing;
pub(super) mod state;
