//! `difference`: Cz = Kz·(A − B), JP H07-61598 B2. Cz is the compensation value, Kz the gain. A and B are the two
//! inputs, or the pair of inputs with the best fit. If one sensor fails, the remaining sensor is used alone: see
//! `identified/single_sensor.rs`.

use crate::gram::{Gains, Gram};

pub(super) fn fit(gram: &Gram, columns: &[usize]) -> Result<Gains, String> {
    let mut best: Option<(f64, f64, usize, usize)> = None;
    for (place, a) in columns.iter().enumerate() {
        for b in &columns[place + 1..] {
            let square = gram.square[(*a, *a)] - 2.0 * gram.square[(*a, *b)] + gram.square[(*b, *b)];
            let cross = gram.cross[*a] - gram.cross[*b];
            if square <= 1e-9 * gram.rows {
                continue;
            }
            let left = gram.power - cross * cross / square;
            if best.is_none_or(|(least, ..)| left < least) {
                best = Some((left, cross / square, *a, *b));
            }
        }
    }
    let (_, gain, a, b) = best.ok_or(
        "the method difference needs two sensors whose temperatures change differently: name two such \
         sensors, for example --inputs bed,wheelhead",
    )?;
    Ok(vec![(a, gain), (b, -gain)])
}
