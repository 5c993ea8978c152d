//! The macro `unroll!`: a loop of up to 12 iterations written out at compile time, for the filters
//! of few states.

/// Longest loop that is written out.
pub(crate) const UNROLLED: usize = 12;

/// `for j in 0..N`, written out when `N` is at most [`UNROLLED`].
///
/// The bounds of the loops inside then become constants and the compiler
/// unrolls them too, which it does not do by itself for triangular nests: a
/// factored step of 6 states takes less than half the instructions.
macro_rules! unroll {
    ($j:ident in 0..$n:ident $body:block) => {
        if $n <= $crate::kalman::unroll::UNROLLED {
            unroll!(@ $j $n $body 0 1 2 3 4 5 6 7 8 9 10 11)
        } else {
            for $j in 0..$n $body
        }
    };
    (@ $j:ident $n:ident $body:block $($index:literal)*) => {{
        $(if $index < $n {
            let $j: usize = $index;
            $body
        })*
    }};
}

pub(crate) use unroll;
