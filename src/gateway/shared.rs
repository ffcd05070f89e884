//! Shared state of the gateway's tasks: the lock of the state, the access of a line task to the state, and
//! the calculations that run under the lock.

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
