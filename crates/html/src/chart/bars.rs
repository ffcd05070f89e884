//! Chart of horizontal bars. Each bar has its name to the left and its value as text to the right.

use maud::Markup;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::{COOL, INK, QUIET, count, letters, pixels, sheet, span};

/// Bar of a chart, with the texts to its left and right.
#[derive(Clone, Debug, Default)]
pub struct Bar {
    /// Name to the left of the bar.
    pub name: String,
    /// Length of the bar, in the unit of the chart; a negative bar points to the left.
    pub value: f64,
    /// Uncertainty of `value`. A whisker (error bar) from `value - doubt` to `value + doubt` shows it. With 0, no
    /// whisker is drawn.
    pub doubt: f64,
    /// Length of a second bar, drawn as an outline around this bar; `None` if there is no second bar.
    pub outline: Option<f64>,
    /// Text of the value, printed at the right edge of the chart.
    pub figure: String,
}

const WIDTH: f64 = 480.0;
const ROW: f64 = 28.0;
/// Approximate width of one letter, in pixels. The space for the texts next to the bars is calculated from it.
const LETTER: f64 = 9.6;

/// Draws the bars one below the other, on a common scale that includes zero. `says` is the text for screen readers.
pub fn bars(says: &str, all: &[Bar]) -> Markup {
    let ends = all
        .iter()
        .flat_map(|bar| [bar.value - bar.doubt, bar.value + bar.doubt, bar.outline.unwrap_or(bar.value)]);
    let (low, high) = span(ends, true);
    let widest = |text: fn(&Bar) -> &str| {
        let letters = all.iter().map(|bar| text(bar).chars().count()).max().unwrap_or(0);
        count(letters) * LETTER + 8.0
    };
    let (before, behind) = (widest(|bar| &bar.name).min(210.0), widest(|bar| &bar.figure).min(160.0));
    let place = |value: f64| before + (value - low) / (high - low) * (WIDTH - before - behind);
    let height = count(all.len()) * ROW + 8.0;
    let most = letters_in(before);
    sheet(480, pixels(height).unsigned_abs(), says, |paper| {
        let right = letters(16.0, INK).pos(Pos::new(HPos::Right, VPos::Center));
        let stroke = |x: f64, from: f64, to: f64, color: RGBColor| {
            let x = pixels(x);
            PathElement::new([(x, pixels(from)), (x, pixels(to))], color.stroke_width(2))
        };
        for (row, bar) in all.iter().enumerate() {
            let middle = (count(row) + 0.5) * ROW + 4.0;
            let (top, bottom) = (pixels(middle - 8.0), pixels(middle + 8.0));
            let across = |from: f64, to: f64| {
                [(pixels(place(from.min(to))), top), (pixels(place(from.max(to))), bottom)]
            };
            let name = shortened(&bar.name, most);
            paper.draw(&Text::new(name, (pixels(before - 8.0), pixels(middle)), right.clone()))?;
            paper.draw(&Rectangle::new(across(0.0, bar.value), COOL.filled()))?;
            if let Some(outline) = bar.outline {
                paper.draw(&Rectangle::new(across(0.0, outline), INK.stroke_width(1)))?;
            }
            if bar.doubt > 0.0 {
                let (from, to) = (place(bar.value - bar.doubt), place(bar.value + bar.doubt));
                let whisker = [(pixels(from), pixels(middle)), (pixels(to), pixels(middle))];
                paper.draw(&PathElement::new(whisker, INK.stroke_width(2)))?;
                paper.draw(&stroke(from, middle - 5.0, middle + 5.0, INK))?;
                paper.draw(&stroke(to, middle - 5.0, middle + 5.0, INK))?;
            }
            paper.draw(&Text::new(
                bar.figure.clone(),
                (pixels(WIDTH - 2.0), pixels(middle)),
                right.clone(),
            ))?;
        }
        paper.draw(&stroke(place(0.0), 2.0, height - 2.0, QUIET))?;
        Ok(())
    })
}

fn letters_in(pixels: f64) -> usize {
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "fewer than a hundred letters"
    )]
    let letters = ((pixels - 8.0) / LETTER).max(4.0) as usize;
    letters
}

fn shortened(name: &str, most: usize) -> String {
    if name.chars().count() <= most {
        return name.to_owned();
    }
    name.chars().take(most - 1).chain(['…']).collect()
}
