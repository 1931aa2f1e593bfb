//! Doubles as integers: every finite double is an integer times a power of two, so sums and products of doubles can be
//! computed without rounding.

use std::fmt::Debug;
use std::ops::{Add, Mul, Neg, Sub};

use num_bigint::BigInt;

/// Integer types to compute with: `BigInt` can hold every result; `i128` is faster and panics if it overflows.
pub(crate) trait Integer:
    Clone
    + Debug
    + Ord
    + From<i64>
    + TryFrom<BigInt, Error: Debug>
    + Neg<Output = Self>
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
{
}

impl Integer for i128 {}
impl Integer for BigInt {}

pub(crate) type Vector<T> = [T; 3];

/// `x * 2^exponent`.
///
/// # Panics
/// If the result is no integer: `exponent` is less than [`exponent_of`] it.
pub(crate) fn integer(x: f64, exponent: i32) -> BigInt {
    let (mantissa, power) = parts(x);
    let shift = power + exponent;
    assert!(mantissa == 0 || shift >= 0, "{x:e} is no multiple of 2^-{exponent}");
    BigInt::from(mantissa) << shift.max(0) as u32
}

/// The smallest exponent, at least 0, for which `x * 2^exponent` is an integer.
pub(crate) fn exponent_of(x: f64) -> i32 {
    let (mantissa, power) = parts(x);
    if mantissa == 0 { 0 } else { (-power).max(0) }
}

/// `x = mantissa * 2^power` with an odd mantissa, or zero.
fn parts(x: f64) -> (i64, i32) {
    assert!(x.is_finite());
    let bits = x.abs().to_bits();
    let (exponent, fraction) = ((bits >> 52) as i32, (bits & ((1 << 52) - 1)) as i64);
    let (mantissa, power) = if exponent == 0 { (fraction, -1074) } else { (fraction | 1 << 52, exponent - 1075) };
    let zeros = if mantissa == 0 { 0 } else { mantissa.trailing_zeros() };
    let mantissa = mantissa >> zeros;
    (if x < 0.0 { -mantissa } else { mantissa }, power + zeros as i32)
}

pub(crate) fn sub<T: Integer>(a: &Vector<T>, b: &Vector<T>) -> Vector<T> {
    std::array::from_fn(|i| a[i].clone() - b[i].clone())
}

pub(crate) fn dot<T: Integer>(a: &Vector<T>, b: &Vector<T>) -> T {
    (1..3).fold(a[0].clone() * b[0].clone(), |sum, i| sum + a[i].clone() * b[i].clone())
}

pub(crate) fn cross<T: Integer>(a: &Vector<T>, b: &Vector<T>) -> Vector<T> {
    std::array::from_fn(|i| {
        let (j, k) = ((i + 1) % 3, (i + 2) % 3);
        a[j].clone() * b[k].clone() - a[k].clone() * b[j].clone()
    })
}
