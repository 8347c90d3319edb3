//! Histogram of ignition delays: every pulse that ignited, by the time that it had waited.
//!
//! Two bins to an octave, so that one histogram shows delays of 100 kHz and of 1 kHz: bin n ends at [`upper`]`(n)` core cycles.
//! Bin 0 has all shorter delays, the last one all longer ones. Counts wrap: of two readings the difference counts.
//!
//! Delays of a gap that ignites at a constant hazard are exponential (Laue); a second level of delays, or many in the first
//! bins, show another process: particles that bridge the gap, or channels that have not recovered.

/// Bins.
pub const BINS: usize = 32;
/// Octave of the first bin: it ends at 3 * 2^(FIRST - 1) cycles, 0.57 us.
const FIRST: u32 = 6;

/// Pulses by ignition delay.
pub type Delays = [u32; BINS];

/// The bin of a delay, core cycles.
#[inline(always)]
pub fn bin(cycles: u32) -> usize {
    let cycles = cycles.max(1 << FIRST);
    let octave = 31 - cycles.leading_zeros();
    let half = cycles.wrapping_shr(octave.wrapping_sub(1)) & 1;
    ((2 * octave + half).wrapping_sub(2 * FIRST) as usize).min(BINS - 1)
}

/// Delay at which a bin ends, core cycles; of the last one `None`.
pub const fn upper(bin: usize) -> Option<u32> {
    if bin >= BINS - 1 {
        return None;
    }
    let octave = FIRST + bin as u32 / 2;
    Some(if bin.is_multiple_of(2) { 3 << (octave - 1) } else { 1 << (octave + 1) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_delay_lies_in_its_bin() {
        let mut lower = 0;
        for at in 0..BINS {
            let end = upper(at);
            assert_eq!(bin(lower), at, "{lower}");
            assert_eq!(bin(end.unwrap_or(u32::MAX) - u32::from(end.is_some())), at, "{end:?}");
            lower = end.unwrap_or(u32::MAX);
        }
        assert_eq!((upper(0), upper(1), upper(30)), (Some(96), Some(128), Some(3 << 20)));
    }
}
