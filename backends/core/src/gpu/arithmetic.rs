//! What a kernel does so that its numbers are the processor's in every bit.
//!
//! A shading language allows a driver to fuse a product with a sum, and to be off by 2.5 units in the last place of a quotient. A ray
//! through an edge then hits another voxel: on an H100, four pixels in a thousand of the hard test pictures. SPIR-V can forbid the
//! first, WGSL can not. What a driver does right of its own accord is left out.

use crate::DeviceKind;

/// What a kernel does itself, and does not leave to the driver.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub struct Arithmetic {
    /// Rounds products before they are added. Otherwise the driver must not fuse them, or does not.
    pub rounds_products: bool,
    /// Rounds quotients to the nearest number, as the driver otherwise does.
    pub rounds_quotients: bool,
}

impl Arithmetic {
    /// The driver rounds every operation as it is written.
    pub const PLAIN: Self = Self { rounds_products: false, rounds_quotients: false };
    /// Nothing is left to the driver.
    pub const EXACT: Self = Self { rounds_products: true, rounds_quotients: true };

    /// What WGSL needs on devices of a kind: drivers that run on the processor divide with its instructions.
    pub fn on(kind: DeviceKind) -> Self {
        Self { rounds_quotients: kind != DeviceKind::SoftwareGpu, ..Self::EXACT }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_gpu_is_left_nothing_and_products_are_left_to_no_driver() {
        assert_eq!(Arithmetic::on(DeviceKind::Gpu), Arithmetic::EXACT);
        assert!(DeviceKind::ALL.into_iter().all(|kind| Arithmetic::on(kind).rounds_products));
    }
}
