//! What the source of a machine reports about it, to be told beside our own figures. The plants are ours.

use serde::Deserialize;

/// A publication's figures.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Published {
    /// Where they stand, and what they are.
    pub text: String,
    /// One for each figure it gives.
    #[serde(default, rename = "axis")]
    pub axes: Vec<PublishedAxis>,
}

/// One axis of a publication.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PublishedAxis {
    /// Its name in the profile.
    pub name: String,
    /// The error without compensation, µm.
    pub uncompensated_um: Option<f64>,
    /// What is left with it, µm.
    pub compensated_um: Option<f64>,
}
