//! Small systems of linear equations.

use std::ops::{Index, IndexMut};

/// The solution of A x = b in the first `count` places, 0 in the others, for a symmetric positive
/// definite A of which the lower half is read, by Cholesky's A = L Lᵀ. Where A is not positive
/// definite, the solution has numbers that are not finite.
pub(crate) fn solve<const N: usize>(
    mut a: [[f64; N]; N],
    mut b: [f64; N],
    count: usize,
) -> [f64; N] {
    solve_in_place(&mut a, &mut b[..count]);
    b[count..].fill(0.0);
    b
}

/// The same for as many equations as `b` has numbers, which become the solution.
#[inline(always)]
pub(crate) fn solve_in_place<R>(a: &mut [R], b: &mut [f64])
where
    R: Index<usize, Output = f64> + IndexMut<usize>,
{
    let count = b.len();
    for i in 0..count {
        for j in 0..=i {
            let dot: f64 = (0..j).map(|k| a[i][k] * a[j][k]).sum();
            let rest = a[i][j] - dot;
            a[i][j] = if i == j { rest.sqrt() } else { rest / a[j][j] };
        }
        let dot: f64 = (0..i).map(|k| a[i][k] * b[k]).sum();
        b[i] = (b[i] - dot) / a[i][i];
    }
    for i in (0..count).rev() {
        let dot: f64 = (i + 1..count).map(|k| a[k][i] * b[k]).sum();
        b[i] = (b[i] - dot) / a[i][i];
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const N: usize = 8;

    #[test]
    fn a_solution_that_is_known() {
        let matrix: [[f64; N]; N] = std::array::from_fn(|i| {
            std::array::from_fn(|j| if i == j { 3.0 } else { 1.0 / (1.0 + (i + j) as f64) })
        });
        let x = [1.0, -2.0, 3.0, 0.5, 0.0, 7.0, -1.0, 2.0];
        for count in [1, 5, N] {
            let b = matrix.map(|row| (0..count).map(|j| row[j] * x[j]).sum());
            let solution = solve(matrix, b, count);
            let close = |i: usize| (solution[i] - x[i]).abs() < 1e-12;
            assert!((0..count).all(close), "{solution:?}");
            assert!(solution[count..].iter().all(|&x| x == 0.0));
        }
    }

    #[test]
    fn matrices_that_are_not_positive_definite() {
        for a in [[[0.0, 0.0], [0.0, 1.0]], [[1.0, 2.0], [2.0, 1.0]], [[1.0, 1.0], [1.0, 1.0]]] {
            let solution = solve(a, [1.0, 2.0], 2);
            assert!(solution.iter().any(|x| !x.is_finite()), "{a:?}: {solution:?}");
        }
    }
}
