//! Lines over a length.

use maud::Markup;
use plotters::prelude::*;

use super::{INK, Line, Look, QUIET, WARM, plot, sheet, span};

/// Lines over a position in mm, values in `unit`.
pub fn along(unit: &str, across: &str, says: &str, all: &[Line]) -> Markup {
    let points = || all.iter().flat_map(|line| line.points.iter().copied());
    let (low, high) = span(points().map(|(_, value)| value), true);
    let (left, right) = span(points().map(|(at, _)| at), false);
    sheet(480, 300, says, |paper| {
        let mut chart = plot(paper, (left, right), (low, high), across, unit)?;
        if low < 0.0 && high > 0.0 {
            chart.draw_series(LineSeries::new([(left, 0.0), (right, 0.0)], QUIET))?;
        }
        for line in all {
            let points = line.points.iter().copied();
            match line.look {
                Look::Dashed => {
                    chart.draw_series(DashedLineSeries::new(points, 7, 4, WARM.stroke_width(2)))?;
                }
                Look::Solid => {
                    chart.draw_series(LineSeries::new(points, INK.stroke_width(2)))?;
                }
                Look::Filled | Look::Faint => {
                    chart.draw_series(points.map(|point| Circle::new(point, 4, INK.stroke_width(1))))?;
                }
            }
        }
        Ok(())
    })
}
