//! State that the tasks of the gateway share: the lock of the state, the access of a bus line to the state, and the
//! calculations that run while the state is locked.

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
