//! Executes the actions of the controllers of outputs, and gives them the results. Decides nothing about a register.
//!
//! The task of a line owns an executor for each of its outputs. This is a [`Single`] if the output is written by
//! itself, or a [`Position`] if it is a corrected position. Outputs that are written together have one [`Set`]. A
//! [`Single`] has a [`register::OutputRegister`] and a [`Controller`](isotherm_core::output::Controller). A [`Set`] has
//! a register for each output, and a [`SetController`](isotherm_core::output::SetController). A turn is the work of the
//! line task on one output or set. It begins with the demand of the axis. Then each action is one exchange, and its
//! result is the next input, until there is nothing to do. A reference position is an output without a step or a limit.

mod demand;
mod failures;
mod position;
mod register;
mod report;
mod set;
mod set_io;
mod set_modbus;
mod set_opcua;
mod single;
mod strobe;
mod turn;

pub(super) use position::Position;
pub(super) use set::Set;
pub(super) use single::Single;
pub(super) use turn::LineTurn;
