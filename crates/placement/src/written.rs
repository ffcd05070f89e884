//! What goes to the machine: P as the file that `kind = "matrix"` reads, and the model's block for the profile.

use std::fmt::Write;
use std::str::FromStr;

use crate::blocks::AXES;
use crate::found::Found;
use crate::problem::count;

/// P along one line: a guideway of several rails as their mean.
#[derive(Clone, Debug, PartialEq)]
pub struct Along {
    /// The direction of the guideway: 0 x, 1 y, 2 z.
    pub axis: usize,
    /// How many rails it has.
    pub rails: usize,
    /// Where its points lie in this direction, mm, ascending.
    pub guide_mm: Vec<f64>,
    /// For each point the guideway nodes (places in their list) it is made of, with their shares.
    weights: Vec<Vec<(usize, f64)>>,
}

/// Points nearer than this share of the guideway's length are one.
const SAME: f64 = 1e-4;

impl Along {
    /// From the coordinates of the guideway's nodes; the direction is the longest where none is given.
    ///
    /// Rails are told apart by the largest gap across the guideway. Each is interpolated linearly to the points of all,
    /// and where several nodes of a rail have the same place, they count as one.
    #[must_use]
    pub fn new(guide: &[[f64; 3]], axis: Option<usize>) -> Along {
        let reach = |axis: usize| {
            let places = || guide.iter().map(|xyz| xyz[axis]);
            places().fold(f64::NEG_INFINITY, f64::max) - places().fold(f64::INFINITY, f64::min)
        };
        let longest = || (0..3).max_by(|one, other| reach(*one).total_cmp(&reach(*other))).unwrap_or(0);
        let axis = axis.unwrap_or_else(longest);
        let same = SAME * reach(axis).max(f64::MIN_POSITIVE);
        let mut rails = vec![(0..guide.len()).collect::<Vec<usize>>()];
        for across in (0..3).filter(|across| *across != axis) {
            rails = rails.into_iter().flat_map(|rail| apart(guide, rail, across)).collect();
        }
        let lines: Vec<Vec<(f64, Vec<usize>)>> =
            rails.iter().map(|rail| line(guide, rail, axis, same)).collect();
        let mut guide_mm: Vec<f64> = lines.iter().flatten().map(|(at, _)| *at).collect();
        guide_mm.sort_by(f64::total_cmp);
        guide_mm.dedup_by(|next, kept| *next - *kept <= same);
        let weights = guide_mm
            .iter()
            .map(|at| {
                let each = 1.0 / count(lines.len().max(1));
                lines
                    .iter()
                    .flat_map(|line| shares(line, *at))
                    .map(|(node, share)| (node, share * each))
                    .collect()
            })
            .collect();
        Along { axis, rails: rails.len(), guide_mm, weights }
    }

    /// A quantity of the guideway's nodes (rows 3·guide + component) in one direction, at each point.
    #[must_use]
    pub fn of(&self, values: &[f64], component: usize) -> Vec<f64> {
        let point = |weights: &Vec<(usize, f64)>| {
            weights.iter().map(|(node, share)| share * values[3 * node + component]).sum()
        };
        self.weights.iter().map(point).collect()
    }
}

/// Nodes in two halves where the largest gap between them is more than half of their extent.
fn apart(guide: &[[f64; 3]], mut rail: Vec<usize>, across: usize) -> Vec<Vec<usize>> {
    rail.sort_by(|one, other| guide[*one][across].total_cmp(&guide[*other][across]));
    let at = |place: usize| guide[rail[place]][across];
    let Some(last) = rail.len().checked_sub(1) else { return vec![rail] };
    let extent = at(last) - at(0);
    match (1..rail.len())
        .max_by(|one, other| (at(*one) - at(one - 1)).total_cmp(&(at(*other) - at(other - 1))))
    {
        Some(gap) if at(gap) - at(gap - 1) > 0.5 * extent && extent > 0.0 => {
            let far = rail.split_off(gap);
            // A single node is no rail.
            if rail.len() < 2 || far.len() < 2 { vec![[rail, far].concat()] } else { vec![rail, far] }
        }
        _ => vec![rail],
    }
}

/// A rail's points, ascending, each with its nodes.
fn line(guide: &[[f64; 3]], rail: &[usize], axis: usize, same: f64) -> Vec<(f64, Vec<usize>)> {
    let mut nodes = rail.to_vec();
    nodes.sort_by(|one, other| guide[*one][axis].total_cmp(&guide[*other][axis]));
    let mut points: Vec<(f64, Vec<usize>)> = Vec::new();
    for node in nodes {
        let at = guide[node][axis];
        match points.last_mut() {
            Some((last, nodes)) if at - *last <= same => nodes.push(node),
            _ => points.push((at, vec![node])),
        }
    }
    points
}

/// What a rail is made of at a place: between two of its points of both, beyond its ends of the end.
fn shares(line: &[(f64, Vec<usize>)], at: f64) -> Vec<(usize, f64)> {
    let after = line.partition_point(|(point, _)| *point <= at);
    let (low, high) = (after.saturating_sub(1), after.min(line.len().saturating_sub(1)));
    let span = line[high].0 - line[low].0;
    let share = if span > 0.0 { ((at - line[low].0) / span).clamp(0.0, 1.0) } else { 0.0 };
    let of = |point: usize, share: f64| {
        let nodes = &line[point].1;
        nodes.iter().map(move |node| (*node, share / count(nodes.len())))
    };
    of(low, 1.0 - share).chain(of(high, share)).filter(|(_, share)| *share > 0.0).collect()
}

/// A part that rides on the guideway, has a sensor of its own and grows by itself: what is carried moves as much wherever
/// it stands.
#[derive(Clone, Debug, PartialEq)]
pub struct Rider {
    /// The name of its sensor's signal.
    pub name: String,
    /// Along x, y and z, µm/K.
    pub moves: [f64; 3],
}

impl FromStr for Rider {
    type Err = String;

    fn from_str(text: &str) -> Result<Rider, String> {
        let wrong =
            || format!("`{text}` is no rider; write its signal and µm per kelvin, as in head:z=-4.95");
        let (name, rest) = text.split_once(':').filter(|(name, _)| !name.is_empty()).ok_or_else(wrong)?;
        let mut moves = [0.0; 3];
        for each in rest.split('/') {
            let (axis, value) = each.split_once('=').ok_or_else(wrong)?;
            let axis = AXES.iter().position(|known| *known == axis.trim()).ok_or_else(wrong)?;
            let value = value.trim().parse::<f64>().ok().filter(|value| value.is_finite());
            moves[axis] = value.ok_or_else(wrong)?;
        }
        Ok(Rider { name: name.to_owned(), moves })
    }
}

/// The matrix file: a column for each block, then one for each rider.
#[must_use]
pub fn matrix(found: &Found, along: &Along, riders: &[Rider]) -> String {
    let column = |block: usize| -> Vec<f64> { found.p.iter().map(|row| row[block]).collect() };
    let columns: Vec<Vec<Vec<f64>>> = (0..found.blocks.len())
        .map(|block| (0..3).map(|component| along.of(&column(block), component)).collect())
        .collect();
    let mut rows = Vec::new();
    for point in 0..along.guide_mm.len() {
        for component in 0..3 {
            let blocks = columns.iter().map(|column| column[component][point]);
            let riders = riders.iter().map(|rider| rider.moves[component] / 1000.0);
            let row: Vec<f64> = blocks.chain(riders).collect();
            rows.push(format!("    {}", serde_json::json!(row)));
        }
    }
    format!(
        "{{\n  \"format\": \"isotherm-matrix\", \"version\": 1,\n  \"blocks\": {},\n  \"guide_mm\": {},\n  \"P\": [\n{}\n  ]\n}}\n",
        serde_json::json!(signals(found, riders)),
        serde_json::json!(along.guide_mm),
        rows.join(",\n")
    )
}

/// One name per block, then per rider, as a profile wants them: small letters, digits, underlines.
#[must_use]
pub fn signals(found: &Found, riders: &[Rider]) -> Vec<String> {
    let small = |letter: char| if letter.is_ascii_alphanumeric() { letter.to_ascii_lowercase() } else { '_' };
    let names = found.blocks.iter().chain(riders.iter().map(|rider| &rider.name));
    names.map(|name| name.chars().map(small).collect()).collect()
}

/// The block for the profile; `file` is the matrix file's name.
#[must_use]
pub fn block(found: &Found, along: &Along, riders: &[Rider], file: &str) -> String {
    let mut text = String::new();
    let axis = AXES[along.axis];
    let names = signals(found, riders);
    let mut line = |words: std::fmt::Arguments<'_>| {
        // Writing into a string does not fail.
        let _ = writeln!(text, "{words}");
    };
    line(format_args!(
        "# Displacement of the guideway by block temperatures, from a finite-element model (isotherm place)."
    ));
    line(format_args!("# Sensors, coordinates of the mesh in mm:"));
    for (sensor, name) in found.sensors.iter().zip(&names) {
        let [x, y, z] = sensor.xyz;
        line(format_args!("#   {name}: x {x:.0}, y {y:.0}, z {z:.0} (node {})", sensor.node));
    }
    line(format_args!(
        "# On the load cases the model was made with {:.1} µm RMS are left; blocks alone could leave {:.1}.",
        found.rms_um, found.floor_um
    ));
    for component in found.axes.iter().map(|component| AXES[*component]) {
        line(format_args!("[[axis.{component}.model]]"));
        line(format_args!("name      = \"blocks of the structure\""));
        line(format_args!("kind      = \"matrix\""));
        line(format_args!("file      = {file:?}"));
        line(format_args!("inputs    = {}", serde_json::json!(names).to_string().replace("\",\"", "\", \"")));
        line(format_args!("reference = \"start\""));
        line(format_args!(
            "position  = \"scale_{axis}\"   # the axis along the guideway, mm, with its zero where the mesh has it"
        ));
        line(format_args!("component = \"{component}\""));
        line(format_args!("carries   = \"tool\"      # or \"work\": what rides on the guideway"));
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_rails_are_one_line_in_their_middle() {
        let rail = |x: f64| [0.0, 300.0, 600.0].map(|y| [x, y, 5.0]);
        let guide: Vec<[f64; 3]> = rail(-190.0).into_iter().chain(rail(190.0)).collect();
        let along = Along::new(&guide, None);
        assert_eq!((along.axis, along.rails), (1, 2));
        assert_eq!(along.guide_mm, [0.0, 300.0, 600.0]);
        let values: Vec<f64> = (0..18).map(f64::from).collect();
        // Nodes 0 and 3 stand at the first point: rows 2 and 11 are their z.
        assert_eq!(along.of(&values, 2), [6.5, 9.5, 12.5]);
    }

    #[test]
    fn rails_with_nodes_at_other_heights_are_interpolated_to_all_heights() {
        let guide = [
            [-100.0, 0.0, 0.0],
            [-100.0, 200.0, 0.0],
            [100.0, 0.0, 0.0],
            [100.0, 100.0, 0.0],
            [100.0, 200.0, 0.0],
        ];
        let along = Along::new(&guide, None);
        assert_eq!(along.guide_mm, [0.0, 100.0, 200.0]);
        let moved = [0.0, 4.0, 0.0, 0.0, 0.0].map(|x| [x, 0.0, 0.0]).concat();
        assert_eq!(along.of(&moved, 0), [0.0, 1.0, 2.0]);
    }

    #[test]
    fn a_single_line_of_nodes_is_one_rail() {
        let guide = [[0.0, 3.0, 0.0], [0.0, 1.0, 0.0], [0.0, 2.0, 0.0]];
        let along = Along::new(&guide, None);
        assert_eq!((along.rails, along.guide_mm), (1, vec![1.0, 2.0, 3.0]));
    }
}
