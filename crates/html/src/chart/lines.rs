//! Line charts over the time in hours or over a position, a curve over the index of its values, and a scatter plot.

use maud::Markup;
use plotters::prelude::*;

use super::{Axes, COOL, Drawn, INK, Plot, QUIET, WARM, count, hours, sheet, span, tick};

/// Style of a line. The styles can be distinguished without colour.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LineStyle {
    /// Thick and black.
    Solid,
    /// Dashed, in dark orange.
    Dashed,
    /// Filled area between the line and zero.
    Filled,
    /// Thin and grey, for one of many lines in a chart.
    Faint,
    /// Circles at the points, without a line between them.
    Points,
}

/// Line of a chart. The horizontal axis of the chart is the time in hours, or a position.
#[derive(Clone, Debug)]
pub struct Line {
    /// Style of the line, for example dashed.
    pub style: LineStyle,
    /// Points of the line: horizontal coordinate (time in hours, or position), and value.
    pub points: Vec<(f64, f64)>,
}

/// Maximum number of points of a line. A printer cannot resolve more points in the width of a chart.
const MOST_POINTS: usize = 200;
/// Maximum number of points of a [`LineStyle::Faint`] line. A chart may have many of these lines.
const MOST_POINTS_FAINT: usize = 80;

impl Line {
    /// Creates a line from the finite values. If there are too many points, each interval keeps only its minimum and
    /// its maximum, so that no spike is lost.
    pub fn new(style: LineStyle, points: impl Iterator<Item = (f64, f64)>) -> Line {
        let all: Vec<(f64, f64)> = points.filter(|(_, value)| value.is_finite()).collect();
        let most = if style == LineStyle::Faint { MOST_POINTS_FAINT } else { MOST_POINTS };
        let stretch = all.len().div_ceil(most / 2);
        if stretch <= 2 {
            return Line { style, points: all };
        }
        let ends = |stretch: &[(f64, f64)]| {
            let by = |one: &&(f64, f64), other: &&(f64, f64)| one.1.total_cmp(&other.1);
            let (low, high) = (stretch.iter().min_by(by).copied(), stretch.iter().max_by(by).copied());
            let mut ends: Vec<(f64, f64)> = low.into_iter().chain(high).collect();
            ends.sort_by(|one, other| one.0.total_cmp(&other.0));
            ends
        };
        Line { style, points: all.chunks(stretch).flat_map(ends).collect() }
    }
}

/// Draws lines over the time in hours, in a chart of `width` × `height` pixels. `within` is the range of the vertical
/// axis; charts with the same range can be compared. With `None`, the values determine the range.
pub fn lines(
    width: u32,
    height: u32,
    unit: &str,
    says: &str,
    all: &[Line],
    within: Option<(f64, f64)>,
) -> Markup {
    let points = || all.iter().flat_map(|line| line.points.iter().copied());
    let y = within.unwrap_or_else(|| span(points().map(|(_, value)| value), false));
    let last = points().map(|(hour, _)| hour).fold(0.1, f64::max);
    let (marks, right) = if width < 300 { ((3, 3), 12) } else { ((6, 6), 16) };
    let axes = Axes { x: (0.0, last), y, unit, across: "", written: &hours, marks, right };
    sheet(width, height, says, |paper| draw(&mut axes.plot(paper)?, &axes, all))
}

/// Draws lines over a position. `unit` is the unit of the values, and `across` is the label of the horizontal axis.
/// `says` is the text for screen readers.
pub fn along(unit: &str, across: &str, says: &str, all: &[Line]) -> Markup {
    let points = || all.iter().flat_map(|line| line.points.iter().copied());
    let y = span(points().map(|(_, value)| value), true);
    let x = span(points().map(|(at, _)| at), false);
    let axes = Axes { x, y, unit, across, written: &|value| tick(*value), marks: (6, 6), right: 20 };
    sheet(480, 300, says, |paper| draw(&mut axes.plot(paper)?, &axes, all))
}

fn draw(chart: &mut Plot<'_, '_>, axes: &Axes<'_>, all: &[Line]) -> Drawn {
    if axes.y.0 < 0.0 && axes.y.1 > 0.0 {
        chart.draw_series(LineSeries::new([(axes.x.0, 0.0), (axes.x.1, 0.0)], QUIET))?;
    }
    // Filled areas are drawn below the lines.
    let (filled, drawn): (Vec<&Line>, Vec<&Line>) =
        all.iter().partition(|line| line.style == LineStyle::Filled);
    for line in filled.into_iter().chain(drawn) {
        let points = line.points.iter().copied();
        match line.style {
            LineStyle::Filled => {
                let area = AreaSeries::new(points, 0.0, COOL.mix(0.75)).border_style(QUIET);
                chart.draw_series(area).map(drop)?;
            }
            LineStyle::Faint => chart.draw_series(LineSeries::new(points, QUIET.mix(0.6))).map(drop)?,
            LineStyle::Solid => chart.draw_series(LineSeries::new(points, INK.stroke_width(2))).map(drop)?,
            LineStyle::Dashed => {
                chart.draw_series(DashedLineSeries::new(points, 7, 4, WARM.stroke_width(2))).map(drop)?;
            }
            LineStyle::Points => {
                let circles = points.map(|point| Circle::new(point, 4, INK.stroke_width(1)));
                chart.draw_series(circles).map(drop)?;
            }
        }
    }
    Ok(())
}

/// Draws `values` over their index, from 0 on. The value at the index `marked` gets a ring. A dashed horizontal line is
/// drawn at `level`.
pub fn curve(unit: &str, says: &str, values: &[f64], marked: usize, level: f64) -> Markup {
    let (_, high) = span(values.iter().copied().chain([level]), true);
    let places = || values.iter().enumerate().map(|(place, value)| (count(place), *value));
    let x = (-0.3, count(values.len().saturating_sub(1)) + 0.3);
    let whole = |value: &f64| if value.fract().abs() < 1e-6 { tick(*value) } else { String::new() };
    let marks = (values.len(), 6);
    let axes = Axes { x, y: (0.0, high), unit, across: "", written: &whole, marks, right: 16 };
    sheet(480, 280, says, |paper| {
        let mut chart = axes.plot(paper)?;
        let across = [(x.0, level), (x.1, level)];
        chart.draw_series(DashedLineSeries::new(across, 7, 4, WARM.stroke_width(2)))?;
        chart.draw_series(LineSeries::new(places(), INK.stroke_width(2)))?;
        chart.draw_series(places().map(|place| Circle::new(place, 4, INK.filled())))?;
        let ring = places().skip(marked).take(1);
        chart.draw_series(ring.map(|place| Circle::new(place, 10, INK.stroke_width(2))))?;
        Ok(())
    })
}

/// Draws each pair `(x, y)` as a point, and the diagonal line on which x equals y. Both axes have the same range and
/// the same unit.
pub fn scatter(unit: &str, says: &str, pairs: &[(f64, f64)]) -> Markup {
    let (low, high) = span(pairs.iter().flat_map(|(one, other)| [*one, *other]), true);
    let both = (low, high);
    let written = |value: &f64| tick(*value);
    let axes = Axes { x: both, y: both, unit, across: "", written: &written, marks: (6, 6), right: 20 };
    sheet(480, 440, says, |paper| {
        let mut chart = axes.plot(paper)?;
        chart.draw_series(pairs.iter().map(|pair| Circle::new(*pair, 2, INK.mix(0.35).filled())))?;
        chart.draw_series(LineSeries::new([(low, low), (high, high)], WARM.stroke_width(2)))?;
        Ok(())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_thinned_out_and_keeps_its_spike_and_its_order() {
        let value = |minute: u32| if minute == 777 { 9.0 } else { f64::from(minute) * 1e-3 };
        let line =
            Line::new(LineStyle::Solid, (0..5000).map(|minute| (f64::from(minute) / 60.0, value(minute))));
        assert!(line.points.len() <= MOST_POINTS, "{}", line.points.len());
        assert!(line.points.iter().any(|(_, value)| *value > 8.0));
        assert!(line.points.windows(2).all(|pair| pair[0].0 <= pair[1].0));
    }

    #[test]
    fn missing_values_are_no_points() {
        let line = Line::new(LineStyle::Faint, [(0.0, 1.0), (1.0, f64::NAN), (2.0, 3.0)].into_iter());
        assert_eq!(line.points, [(0.0, 1.0), (2.0, 3.0)]);
    }

    #[test]
    fn a_picture_without_points_is_a_picture_all_the_same() {
        for line in [Vec::new(), vec![Line { style: LineStyle::Solid, points: vec![(0.0, 2.0), (1.0, 2.0)] }]]
        {
            let picture = lines(480, 280, "µm", "an \"empty\" one", &line, None).into_string();
            assert!(picture.starts_with("<svg viewBox=\"0 0 480 280\" role=\"img\""), "{picture}");
            assert!(picture.contains("an &quot;empty&quot; one") && picture.ends_with("</svg>"), "{picture}");
            assert!(!picture.contains("NaN") && !picture.contains("http"), "{picture}");
        }
    }
}
