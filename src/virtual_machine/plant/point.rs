//! Where a plant has a temperature.

/// Something that has a temperature.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Point {
    Node(usize),
    Ambient,
    /// A patch of the structure through which heat comes in.
    Port(usize),
    /// A place of the structure that is only looked at.
    Spot(usize),
}
