//! Chart of a correlation matrix. A darker cell means a stronger correlation, and a minus sign means a negative
//! correlation.

use maud::Markup;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::{INK, count, letters, pixels, sheet};

const CELL: f64 = 30.0;
const LETTER: f64 = 8.4;

/// Draws the matrix with one row and one column for each name. A cell shows its correlation in hundredths.
pub fn map(says: &str, names: &[&str], values: &[Vec<f64>]) -> Markup {
    let longest = names.iter().map(|name| name.chars().count()).max().unwrap_or(0);
    let before = count(longest) * LETTER + 34.0;
    // The columns have the numbers of the rows, because vertical names are hard to read.
    let side = count(names.len()) * CELL;
    let (width, height) = (pixels(before + side + 4.0), pixels(side + 30.0));
    sheet(width.unsigned_abs(), height.unsigned_abs(), says, |paper| {
        let right = letters(13.0, INK).pos(Pos::new(HPos::Right, VPos::Center));
        let middle = |color| letters(12.0, color).pos(Pos::new(HPos::Center, VPos::Center));
        for (row, name) in names.iter().enumerate() {
            let top = 26.0 + count(row) * CELL;
            let label = format!("{name} ({})", row + 1);
            paper.draw(&Text::new(label, (pixels(before - 4.0), pixels(top + CELL / 2.0)), right.clone()))?;
            let head = (pixels(before + (count(row) + 0.5) * CELL), 13);
            paper.draw(&Text::new((row + 1).to_string(), head, middle(INK)))?;
            for (column, value) in values[row].iter().enumerate() {
                let left = before + count(column) * CELL;
                let corners =
                    [(pixels(left), pixels(top)), (pixels(left + CELL - 1.0), pixels(top + CELL - 1.0))];
                let (ground, ink) = tones(value.abs());
                paper.draw(&Rectangle::new(corners, ground.filled()))?;
                let hundredths = format!("{:.0}", value * 100.0).replace('-', "−");
                let place = (pixels(left + CELL / 2.0), pixels(top + CELL / 2.0));
                paper.draw(&Text::new(hundredths, place, middle(ink)))?;
            }
        }
        Ok(())
    })
}

/// Returns the background colour and the text colour of a cell. The stronger the correlation, the darker the
/// background, from white to dark blue.
fn tones(strength: f64) -> (RGBColor, RGBColor) {
    // The cube keeps strong correlations distinguishable.
    let share = strength.clamp(0.0, 1.0).powi(3);
    let mixed = |from: u8, to: u8| {
        let value = f64::from(from) + (f64::from(to) - f64::from(from)) * share;
        u8::try_from(pixels(value)).unwrap_or(u8::MAX)
    };
    let ground = RGBColor(mixed(0xf4, 0x0b), mixed(0xf7, 0x4a), mixed(0xf9, 0x63));
    (ground, if share > 0.45 { WHITE } else { INK })
}
