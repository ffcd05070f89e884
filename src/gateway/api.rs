//! Access of the web page, the command socket and programs to the gateway: its status and its commands.

pub(super) mod api_backend;
mod command_handle;
pub mod control;
mod status;
