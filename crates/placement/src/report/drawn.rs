//! The structure in three views, as inline SVG: bands of temperature that also differ in grey.

use std::fmt::Write;

use maud::{Markup, PreEscaped, html};

use super::Subject;
use crate::blocks::AXES;
use crate::problem::{Load, count};
use crate::views::View;
use isotherm_html::figure;

/// From cold to warm: each darker than the one before.
const TONES: [&str; 8] =
    ["#fbf6ec", "#f6e3c0", "#f1c98d", "#e6a85c", "#d38238", "#b35f20", "#8a4013", "#5e260b"];

/// Room around a view, pixels.
const EDGE: f64 = 14.0;

/// Seen along each axis, from the side that shows more sensors.
pub(super) fn views(subject: &Subject<'_>) -> Markup {
    let Some(load) = warmest(subject) else { return html! {} };
    let low = load.rise.iter().copied().fold(f64::INFINITY, f64::min);
    let high = load.rise.iter().copied().fold(f64::NEG_INFINITY, f64::max).max(low + 1e-9);
    let mut owner = vec![usize::MAX; subject.mesh.nodes.len()];
    for (place, part) in subject.parts.iter().enumerate() {
        part.nodes.iter().for_each(|node| owner[*node] = place);
    }
    let pictures: Vec<(String, Markup)> = [2, 0, 1]
        .into_iter()
        .map(|axis| {
            let sides = [true, false].map(|from_above| View::new(subject.mesh, axis, from_above));
            let seen =
                |view: &View| subject.found.sensors.iter().filter(|sensor| view.sees(&sensor.xyz)).count();
            let [above, below] = sides;
            let view = if seen(&above) >= seen(&below) { above } else { below };
            (title(&view), draw(subject, &view, load, &owner, (low, high)))
        })
        .collect();
    html! {
        (scale(&load.name, low, high))
        div .gallery { @for (title, picture) in &pictures { (figure(title, picture, "")) } }
    }
}

/// The case that moves the guideway most.
fn warmest<'a>(subject: &Subject<'a>) -> Option<&'a Load> {
    let most = |place: &usize| subject.found.cases[*place].largest_um;
    let place = (0..subject.loads.len()).max_by(|one, other| most(one).total_cmp(&most(other)))?;
    subject.loads.get(place)
}

fn title(view: &View) -> String {
    let sign = if view.from_above { "+" } else { "−" };
    let right = if view.mirrored() { "−" } else { "" };
    let [across, up] = view.plane.map(|axis| AXES[axis]);
    format!("from {sign}{}: {right}{across} to the right, {up} up", AXES[view.axis])
}

/// Which band a rise lies in.
fn band(rise: f64, (low, high): (f64, f64)) -> usize {
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "one of eight")]
    let band = ((rise - low) / (high - low) * count(TONES.len())).max(0.0) as usize;
    band.min(TONES.len() - 1)
}

fn draw(subject: &Subject<'_>, view: &View, load: &Load, owner: &[usize], ends: (f64, f64)) -> Markup {
    let [width, height] = view.size;
    let mut bands = vec![String::new(); TONES.len()];
    let mut borders = String::new();
    let block = |x: usize, y: usize| view.at(x, y).map(|seen| owner[seen.nearest()]);
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
            @for node in subject.guide {
                @if view.sees(&subject.mesh.xyz[*node]) { (cross(place(&subject.mesh.xyz[*node]))) }
            }
            @for (number, sensor) in subject.found.sensors.iter().enumerate() {
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

/// The bands with their temperatures.
fn scale(name: &str, low: f64, high: f64) -> Markup {
    let wide = 56.0;
    let edge = |place: usize| low + (high - low) * count(place) / count(TONES.len());
    let all = wide * count(TONES.len()) + 40.0;
    let mut text = String::new();
    for (place, tone) in TONES.iter().enumerate() {
        let left = 20.0 + wide * count(place);
        let _ = write!(
            text,
            "<rect x=\"{left}\" y=\"4\" width=\"{wide}\" height=\"18\" fill=\"{tone}\" stroke=\"#4d5a61\" stroke-width=\"1\"/>"
        );
    }
    for place in 0..=TONES.len() {
        let at = 20.0 + wide * count(place);
        let value = isotherm_html::decimals(edge(place), 1);
        let _ = write!(
            text,
            "<text x=\"{at}\" y=\"40\" text-anchor=\"middle\" font-family=\"sans-serif\" font-size=\"15\" fill=\"#14191c\">{value}</text>"
        );
    }
    html! {
        p { "Case " strong { (name) } ", rise in K:" }
        svg viewBox=(format!("0 0 {all} 46")) role="img" aria-label="scale of temperatures" { (PreEscaped(text)) }
    }
}
