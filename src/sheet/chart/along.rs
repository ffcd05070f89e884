//! Lines over a length.

use maud::Markup;
use plotters::prelude::*;

use super::{INK, Line, Look, QUIET, RULE, WARM, letters, sheet, span, tick};

/// Lines over a position in mm, values in `unit`.
pub(crate) fn along(unit: &str, across: &str, says: &str, all: &[Line]) -> Markup {
    let points = || all.iter().flat_map(|line| line.points.iter().copied());
    let (low, high) = span(points().map(|(_, value)| value), true);
    let (left, right) = span(points().map(|(at, _)| at), false);
    sheet(480, 300, says, |paper| {
        let mut chart = ChartBuilder::on(paper)
            .margin_top(26)
            .margin_right(20)
            .x_label_area_size(46)
            .y_label_area_size(50)
            .build_cartesian_2d(left..right, low..high)?;
        chart
            .configure_mesh()
            .x_labels(6)
            .y_labels(6)
            .max_light_lines(0)
            .bold_line_style(RULE)
            .axis_style(QUIET)
            .label_style(letters(16.0, QUIET))
            .x_desc(across)
            .axis_desc_style(letters(16.0, QUIET))
            .x_label_formatter(&|value| tick(*value))
            .y_label_formatter(&|value| tick(*value))
            .draw()?;
        paper.draw(&Text::new(unit.to_owned(), (2, 2), letters(16.0, QUIET)))?;
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
