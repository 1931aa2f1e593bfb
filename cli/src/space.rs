//! Options that say what the space of a mesh means, and names: registered metadata (spec 2.3).

use clap::{Args, ValueEnum};
use esvo_format::{Handedness, Metadata, UpAxis};

use crate::values::parse_positive;

/// Metadata that the user gives.
#[derive(Debug, Default, Args)]
#[command(next_help_heading = "What the file says of its space")]
pub(crate) struct SpaceArguments {
    /// Metres per unit of the mesh, e.g. 0.01 for centimetres
    #[arg(long, value_name = "METRES", value_parser = parse_positive)]
    pub(crate) unit: Option<f64>,
    /// The axis that points up
    #[arg(long, value_name = "AXIS", allow_hyphen_values = true)]
    pub(crate) up: Option<Axis>,
    /// Handedness of the axes
    #[arg(long, value_name = "HAND")]
    pub(crate) handedness: Option<Hand>,
}

/// The axes of [`UpAxis`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Axis {
    #[value(name = "+x", alias = "x")]
    X,
    #[value(name = "-x")]
    MinusX,
    #[value(name = "+y", alias = "y")]
    Y,
    #[value(name = "-y")]
    MinusY,
    #[value(name = "+z", alias = "z")]
    Z,
    #[value(name = "-z")]
    MinusZ,
}

/// The hands of [`Handedness`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Hand {
    Right,
    Left,
}

impl SpaceArguments {
    /// Whether anything is given.
    pub(crate) fn is_given(&self) -> bool {
        self.unit.is_some() || self.up.is_some() || self.handedness.is_some()
    }

    /// Puts what is given in the place of what the metadata say.
    pub(crate) fn apply(&self, metadata: &mut Metadata) {
        let up = self.up.map(|axis| match axis {
            Axis::X => UpAxis::X,
            Axis::MinusX => UpAxis::MinusX,
            Axis::Y => UpAxis::Y,
            Axis::MinusY => UpAxis::MinusY,
            Axis::Z => UpAxis::Z,
            Axis::MinusZ => UpAxis::MinusZ,
        });
        let handedness = self.handedness.map(|hand| match hand {
            Hand::Right => Handedness::Right,
            Hand::Left => Handedness::Left,
        });
        metadata.unit = self.unit.or(metadata.unit);
        metadata.up = up.or(metadata.up);
        metadata.handedness = handedness.or(metadata.handedness);
    }
}
