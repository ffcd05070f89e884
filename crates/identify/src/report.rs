//! Reports of results, as one HTML file without scripts and external resources. It can be sent to a customer.
//!
//! ```text
//! identified ─┬─ logs      runs, sensors, correlation map      selected
//!             ├─ judged    charts and figures of each run
//!             └─ terms     the model, its substitutes, its envelope, the limits in force
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
