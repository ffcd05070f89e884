//! Reports of results. Each report is one HTML file without scripts and external resources, so that it can be sent to a
//! customer.
//!
//! ```text
//! identified ─┬─ logs              runs, sensors, correlation map
//!             ├─ validation_page   charts and figures of each run
//!             └─ terms             the model, its stand-ins, its envelope, the limits in force
//! selection_page                   uses logs and validation_page, too
//! drift_page                       drift in the terms of ISO 230-3
//! ```

mod drift_page;
mod identified;
mod logs;
mod page;
mod selection_page;
mod terms;
mod validation_page;

pub use drift_page::drift_page;
pub use identified::{Subject, identified};
pub use selection_page::selection_page;
