//! Execution of the actions of the output controllers. The controllers decide; this module exchanges messages with the
//! devices, and returns the results to the controllers.
//!
//! The task of a bus line owns an executor for each of its outputs. The executor is a [`Single`] for an
//! output with a separate register, and a [`Position`] for a corrected position. Outputs that are written
//! together share one [`Set`]. A [`Single`] has a [`register::OutputRegister`] and a
//! [`Controller`](isotherm_core::output::Controller). A [`Set`] has a register for each output, and a
//! [`SetController`](isotherm_core::output::SetController). A turn is the work of the line task on one
//! executor. The first input of the controller is the value that the axis requires. Each action is one
//! exchange. The result of the exchange is the next input, until the controller has no further action. The
//! register of a reference position is treated as an output without a step limit.

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
mod turn;

pub(super) use position::Position;
pub(super) use set::Set;
pub(super) use single::Single;
pub(super) use turn::LineTurn;
