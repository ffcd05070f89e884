//! What was found, as one HTML file that a customer can be sent: no script, and nothing from elsewhere.
//!
//! ```text
//! identified ─┬─ logs      runs, sensors, correlation map      selected
//!             ├─ judged    pictures and figures of each run
//!             └─ terms     the model, its stand-ins, its envelope, the limits in force
//! ```

use maud::Markup;

use isotherm_core::quantity::Moment;
use isotherm_html::{chart, date, decimals, duration, figure, number, plain, table, three_digits};

mod drifted;
mod identified;
mod judged;
mod logs;
mod selected;
mod terms;

pub use drifted::drifted;
pub use identified::{Subject, identified};
pub use selected::selected;

/// A whole page.
fn page(title: &str, made: Moment, content: &Markup) -> String {
    isotherm_html::page(title, made, "the logs named here", content)
}
