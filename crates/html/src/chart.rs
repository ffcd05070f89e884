//! Charts as inline SVG. They use black, grey, and two colours that differ in brightness, so that a print without
//! colours is legible.
//!
//! Each chart is drawn for the width of a phone, so that its text is legible on a phone.

use maud::{Markup, PreEscaped, html};
use plotters::coord::Shift;
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;
use plotters::style::TextStyle;

mod bars;
mod lines;
mod map;

pub use bars::{Bar, bars};
pub use lines::{Line, LineStyle, along, curve, lines, scatter};
pub use map::map;

type Paper<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type Drawn = Result<(), DrawingAreaErrorKind<std::io::Error>>;

const INK: RGBColor = RGBColor(0x14, 0x19, 0x1c);
const QUIET: RGBColor = RGBColor(0x4d, 0x5a, 0x61);
const RULE: RGBColor = RGBColor(0xd5, 0xdc, 0xe0);
const WARM: RGBColor = RGBColor(0xb8, 0x50, 0x10);
const COOL: RGBColor = RGBColor(0x8f, 0xb8, 0xcd);

/// Draws a picture of `width` × `height` pixels and returns it as an SVG element. `says` is the text for screen
/// readers.
fn sheet(width: u32, height: u32, says: &str, draw: impl FnOnce(&Paper<'_>) -> Drawn) -> Markup {
    let mut text = String::new();
    let drawn = {
        let paper = SVGBackend::with_string(&mut text, (width, height)).into_drawing_area();
        draw(&paper).and_then(|()| paper.present())
    };
    if let Err(error) = drawn {
        return html! { p { "This picture could not be drawn: " (error.to_string()) } };
    }
    // The root element is replaced: without a fixed size, the page decides the width.
    let inside = text.split_once('>').map_or("", |(_, inside)| inside).replace(" opacity=\"1\"", "");
    let inside = inside.trim_end().trim_end_matches("</svg>");
    html! {
        svg viewBox={ "0 0 " (width) " " (height) } role="img" aria-label=(says) { (PreEscaped(inside)) }
    }
}

type Plot<'a, 'b> = ChartContext<'a, SVGBackend<'b>, Cartesian2d<RangedCoordf64, RangedCoordf64>>;

/// Ranges, labels and margin of the two axes of a plot.
struct Axes<'a> {
    x: (f64, f64),
    y: (f64, f64),
    /// Unit of the values, written above the vertical axis.
    unit: &'a str,
    /// Label below the horizontal axis; empty if the axis has no label.
    across: &'a str,
    /// Formats a number as a label of the horizontal axis.
    written: &'a dyn Fn(&f64) -> String,
    /// Approximate number of labels on the horizontal and on the vertical axis.
    marks: (usize, usize),
    /// Margin to the right of the plot, in pixels.
    right: u32,
}

impl Axes<'_> {
    fn plot<'a, 'b>(
        &self,
        paper: &'a Paper<'b>,
    ) -> Result<Plot<'a, 'b>, DrawingAreaErrorKind<std::io::Error>> {
        let mut chart = ChartBuilder::on(paper)
            .margin_top(26)
            .margin_right(self.right)
            .x_label_area_size(if self.across.is_empty() { 28 } else { 46 })
            .y_label_area_size(50)
            .build_cartesian_2d(self.x.0..self.x.1, self.y.0..self.y.1)?;
        let mut mesh = chart.configure_mesh();
        mesh.x_labels(self.marks.0)
            .y_labels(self.marks.1)
            .max_light_lines(0)
            .bold_line_style(RULE)
            .axis_style(QUIET)
            .label_style(letters(16.0, QUIET))
            .x_label_formatter(&self.written)
            .y_label_formatter(&|value| tick(*value));
        if !self.across.is_empty() {
            mesh.x_desc(self.across).axis_desc_style(letters(16.0, QUIET));
        }
        mesh.draw()?;
        paper.draw(&Text::new(self.unit.to_owned(), (2, 2), letters(16.0, QUIET)))?;
        Ok(chart)
    }
}

/// Returns a text style with letters that are `size` pixels high.
fn letters(size: f64, color: RGBColor) -> TextStyle<'static> {
    // The backend draws letters smaller than requested.
    ("sans-serif", size * 1.24).into_font().color(&color)
}

/// Formats the number at a mark of an axis: at most three decimals, without trailing zeros.
pub fn tick(value: f64) -> String {
    let text = format!("{value:.3}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".to_owned() } else { text.replace('-', "−") }
}

/// Formats the time at a mark of an axis: `value` is in hours, and the text includes the unit.
fn hours(value: &f64) -> String {
    format!("{} h", tick(*value))
}

/// Rounds a coordinate to whole pixels, because the drawing library requires integers.
fn pixels(value: f64) -> i32 {
    #[allow(clippy::cast_possible_truncation, reason = "a coordinate in a picture")]
    let pixels = value.round() as i32;
    pixels
}

/// Returns the lowest and the highest of the finite values, widened by a margin and never equal. With `zero`, the range
/// includes zero.
fn span(values: impl Iterator<Item = f64>, zero: bool) -> (f64, f64) {
    let begin = if zero { (0.0, 0.0) } else { (f64::MAX, f64::MIN) };
    let finite = values.filter(|value| value.is_finite());
    let (low, high) = finite.fold(begin, |(low, high), value| (low.min(value), high.max(value)));
    if low > high {
        return (0.0, 1.0);
    }
    let room = if high - low > 1e-9 { 0.05 * (high - low) } else { 0.5 };
    (low - room, high + room)
}

/// Converts a number of objects in a picture to `f64`, for the calculation of coordinates.
fn count(things: usize) -> f64 {
    #[allow(clippy::cast_precision_loss, reason = "the number of objects in a picture is small")]
    let count = things as f64;
    count
}
