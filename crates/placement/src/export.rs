//! Export for the gateway: the matrix P as a file for a model with `kind = "matrix"`, and the table of this model for
//! the profile. P contains the displacement of the guideway for each block that is 1 K warmer.

use std::str::FromStr;

use serde_json::json;

use crate::guide_line::GuideLine;
use crate::mesh::{AXES, axis_and_value};
use crate::study::Placement;

/// Part that moves on the guideway, has its own sensor, and expands independently. The displacement that it causes does
/// not depend on its position.
#[derive(Clone, Debug, PartialEq)]
pub struct Rider {
    /// Name of the signal that measures the temperature of this part.
    pub name: String,
    /// Displacement of the machine along x, y and z if this part is 1 K warmer, µm/K.
    pub moves: [f64; 3],
}

impl FromStr for Rider {
    type Err = String;

    fn from_str(text: &str) -> Result<Rider, String> {
        let wrong = || {
            format!(
                "`{text}` is not a rider; write the signal of the moving part and its displacement in µm per \
                 kelvin, for example head:z=-4.95"
            )
        };
        let (name, rest) = text.split_once(':').filter(|(name, _)| !name.is_empty()).ok_or_else(wrong)?;
        let mut moves = [0.0; 3];
        for each in rest.split('/') {
            let (axis, value) = axis_and_value(each).ok_or_else(wrong)?;
            moves[axis] = value;
        }
        Ok(Rider { name: name.to_owned(), moves })
    }
}

/// Returns the content of the matrix file, with one column for each block, and then one for each rider (part that moves
/// on the guideway).
#[must_use]
pub fn matrix(placement: &Placement, line: &GuideLine, riders: &[Rider]) -> String {
    let column = |block: usize| -> Vec<f64> { placement.p.iter().map(|row| row[block]).collect() };
    let columns: Vec<[Vec<f64>; 3]> = (0..placement.blocks.len())
        .map(|block| [0, 1, 2].map(|component| line.mean(&column(block), component)))
        .collect();
    let row = |point: usize, component: usize| {
        let blocks = columns.iter().map(|column| column[component][point]);
        let row: Vec<f64> =
            blocks.chain(riders.iter().map(|rider| rider.moves[component] / 1000.0)).collect();
        format!("    {}", json!(row))
    };
    let points = 0..line.guide_mm.len();
    let rows: Vec<String> =
        points.flat_map(|point| [0, 1, 2].map(|component| row(point, component))).collect();
    format!(
        "{{\n  \"format\": \"isotherm-matrix\", \"version\": 1,\n  \"blocks\": {},\n  \"guide_mm\": {},\n  \"P\": [\n{}\n  ]\n}}\n",
        json!(signals(placement, riders)),
        json!(line.guide_mm),
        rows.join(",\n")
    )
}

/// Returns the signal names of the blocks and riders. As a profile requires, they consist of small letters, digits and
/// underscores.
#[must_use]
pub fn signals(placement: &Placement, riders: &[Rider]) -> Vec<String> {
    let small = |letter: char| if letter.is_ascii_alphanumeric() { letter.to_ascii_lowercase() } else { '_' };
    let names = placement.blocks.iter().chain(riders.iter().map(|rider| &rider.name));
    names.map(|name| name.chars().map(small).collect()).collect()
}

/// Returns the `[[axis.….model]]` tables of the profile, one for each direction of the placement. `file` is the name of
/// the matrix file.
#[must_use]
pub fn block(placement: &Placement, line: &GuideLine, riders: &[Rider], file: &str) -> String {
    let names = signals(placement, riders);
    let inputs = json!(names).to_string().replace("\",\"", "\", \"");
    let sensors = placement.sensors.iter().zip(&names).map(|(sensor, name)| {
        let [x, y, z] = sensor.xyz;
        format!("#   {name}: x {x:.0}, y {y:.0}, z {z:.0} (node {})\n", sensor.node)
    });
    let head = format!(
        "# Displacement of the guideway by block temperatures, from a finite-element model (isotherm place).\n\
         # Sensors, coordinates of the mesh in mm:\n{}\
         # Residual error on the load cases of the placement: {:.1} µm RMS. Lower bound with these blocks: {:.1} µm.\n",
        sensors.collect::<String>(),
        placement.rms_um,
        placement.floor_um
    );
    let axis = AXES[line.axis];
    let models = placement.axes.iter().map(|component| {
        let component = AXES[*component];
        format!(
            "[[axis.{component}.model]]\n\
             name      = \"blocks of the structure\"\n\
             kind      = \"matrix\"\n\
             file      = {file:?}\n\
             inputs    = {inputs}\n\
             reference = \"start\"\n\
             position  = \"scale_{axis}\"   # position of the axis along the guideway, mm, in the coordinates of the mesh\n\
             component = \"{component}\"\n\
             carries   = \"tool\"      # or \"work\": the part that moves on the guideway\n"
        )
    });
    head + &models.collect::<String>()
}
