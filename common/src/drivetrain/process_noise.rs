//! Process noise of the drivetrain's filter as a matrix, from the triangle in the image (`noise`).

use nalgebra::SMatrix;

use crate::drivetrain::model::LOADS;

/// `[Q 0; 0 Qd]` from the lower triangle of Q and the diagonal of Qd.
pub(super) fn noise<const NX: usize>(
    triangle: &[f32],
    loads: [f32; LOADS],
) -> SMatrix<f32, NX, NX> {
    let mut matrix = SMatrix::<f32, NX, NX>::zeros();
    fill_noise(matrix.as_mut_slice(), NX, triangle, loads);
    matrix
}

/// One copy for all numbers of states: it runs once, and flash is short.
#[inline(never)]
fn fill_noise(columns: &mut [f32], n: usize, triangle: &[f32], loads: [f32; LOADS]) {
    let mut put = |i: usize, j: usize, value: f32| {
        if let Some(slot) = columns.get_mut(j * n + i) {
            *slot = value;
        }
    };
    let mut entries = triangle.iter();
    for i in 0..n - LOADS {
        for j in 0..=i {
            let value = entries.next().copied().unwrap_or(0.0);
            put(i, j, value);
            put(j, i, value);
        }
    }
    for (d, value) in (n - LOADS..n).zip(loads) {
        put(d, d, value);
    }
}
