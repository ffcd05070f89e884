//! Drawing of the structure in three views, as inline SVG. Each band of temperatures has its own colour. The bands can
//! also be distinguished in a black-and-white print.

use std::fmt::Write;

use maud::{Markup, html};

use crate::blocks::owners;
use crate::mesh::{AXES, count, range};
use crate::problem::Load;
use crate::study::{Placement, Study, moves_most};
use crate::views::View;
use isotherm_html::figure;

/// Colours of the temperature bands, from cold to warm. Each colour is darker than the previous one.
const TONES: [&str; 8] =
    ["#fbf6ec", "#f6e3c0", "#f1c98d", "#e6a85c", "#d38238", "#b35f20", "#8a4013", "#5e260b"];

/// Margin around a view, pixels.
const EDGE: f64 = 14.0;

/// Draws the structure along each axis. Each view is from the side on which more sensors are visible.
pub(super) fn views(study: &Study, placement: &Placement) -> Markup {
    let Some(load) = study.loads.get(moves_most(&placement.cases)) else { return html! {} };
    let (low, high) = range(load.rise.iter().copied());
    let ends = (low, high.max(low + 1e-9));
    let owners = owners(&study.mesh, &study.parts);
    let seen = |view: &View| placement.sensors.iter().filter(|sensor| view.sees(&sensor.xyz)).count();
    let pictures = [2, 0, 1].map(|axis| {
        let [above, below] = [true, false].map(|from_above| View::new(&study.mesh, axis, from_above));
        let view = if seen(&above) >= seen(&below) { above } else { below };
        (title(&view), draw(study, placement, &view, load, &owners, ends))
    });
    html! {
        (scale(&load.name, ends))
        div .gallery { @for (title, picture) in &pictures { (figure(title, picture, "")) } }
    }
}

fn title(view: &View) -> String {
    let sign = if view.from_above { "+" } else { "−" };
    let right = if view.mirrored() { "−" } else { "" };
    let [across, up] = view.plane.map(|axis| AXES[axis]);
    format!("view from {sign}{}: {right}{across} to the right, {up} up", AXES[view.axis])
}

/// Returns the index of the colour band for a temperature rise. `low` and `high` are the smallest and the largest rise
/// of the drawing.
fn band(rise: f64, (low, high): (f64, f64)) -> usize {
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "one of eight")]
    let band = ((rise - low) / (high - low) * count(TONES.len())).max(0.0) as usize;
    band.min(TONES.len() - 1)
}

fn draw(
    study: &Study,
    placement: &Placement,
    view: &View,
    load: &Load,
    owners: &[Option<usize>],
    ends: (f64, f64),
) -> Markup {
    let [width, height] = view.size;
    let mut bands = vec![String::new(); TONES.len()];
    let mut borders = String::new();
    let block = |x: usize, y: usize| view.at(x, y).and_then(|seen| owners[seen.nearest()]);
    for y in 0..height {
        let row = height - 1 - y;
        let shade = |x: usize| view.at(x, row).map(|seen| band(seen.of(&load.rise), ends));
        let mut begin = 0;
        for x in 1..=width {
            let before = shade(begin);
            if x < width && shade(x) == before {
                continue;
            }
            if let Some(band) = before {
                let length = x - begin;
                let left = if view.mirrored() { width - x } else { begin };
                let _ = write!(bands[band], "M{left} {y}h{length}v1h-{length}z");
            }
            begin = x;
        }
        for x in 0..width {
            let own = block(x, row);
            let next = [block(x + 1, row), if row > 0 { block(x, row - 1) } else { own }];
            if own.is_some() && next.iter().any(|next| next.is_some() && *next != own) {
                let left = if view.mirrored() { width - 1 - x } else { x };
                let _ = write!(borders, "M{left} {y}h1v1h-1z");
            }
        }
    }
    let place = |xyz: &[f64; 3]| {
        let [right, up] = view.place(xyz);
        let right = if view.mirrored() { count(width) - right } else { right };
        (right, count(height) - up)
    };
    let (wide, high) = (count(width) + 2.0 * EDGE, count(height) + 2.0 * EDGE);
    html! {
        svg viewBox=(format!("{} {} {wide} {high}", -EDGE, -EDGE)) role="img" aria-label=(format!("the structure {}", title(view))) {
            g shape-rendering="crispEdges" {
                @for (tone, path) in TONES.iter().zip(&bands) { @if !path.is_empty() { path fill=(tone) d=(path) {} } }
                path fill="#14191c" fill-opacity="0.75" d=(borders) {}
            }
            @for xyz in study.guide_xyz().iter().filter(|xyz| view.sees(xyz)) { (cross(place(xyz))) }
            @for (number, sensor) in placement.sensors.iter().enumerate() {
                (ring(place(&sensor.xyz), number + 1, view.sees(&sensor.xyz)))
            }
        }
    }
}

fn cross((x, y): (f64, f64)) -> Markup {
    let d = format!("M{:.1} {:.1}l6 6m0 -6l-6 6", x - 3.0, y - 3.0);
    html! { path d=(d) stroke="#14191c" stroke-width="1.2" fill="none" {} }
}

fn ring((x, y): (f64, f64), number: usize, seen: bool) -> Markup {
    let (x, y) = (format!("{x:.1}"), format!("{y:.1}"));
    html! {
        circle cx=(x) cy=(y) r="11" fill="#fff" fill-opacity=(if seen { "1" } else { "0.55" }) stroke="#14191c"
            stroke-width="2" stroke-dasharray=(if seen { "none" } else { "3 3" }) {}
        text x=(x) y=(y) dy="5" text-anchor="middle" font-family="sans-serif" font-size="14" font-weight="700" fill="#14191c" { (number) }
    }
}

/// Renders the legend of the colour bands with their temperatures.
fn scale(name: &str, (low, high): (f64, f64)) -> Markup {
    const WIDE: f64 = 56.0;
    let left = |place: usize| 20.0 + WIDE * count(place);
    let rise = |place: usize| low + (high - low) * count(place) / count(TONES.len());
    let all = WIDE * count(TONES.len()) + 40.0;
    html! {
        p { "Case " strong { (name) } ", rise in K:" }
        svg viewBox=(format!("0 0 {all} 46")) role="img" aria-label="scale of temperatures" {
            @for (place, tone) in TONES.iter().enumerate() {
                rect x=(left(place)) y="4" width=(WIDE) height="18" fill=(tone) stroke="#4d5a61" stroke-width="1" {}
            }
            @for place in 0..=TONES.len() {
                text x=(left(place)) y="40" text-anchor="middle" font-family="sans-serif" font-size="15" fill="#14191c" {
                    (isotherm_html::decimals(rise(place), 1))
                }
            }
        }
    }
}
