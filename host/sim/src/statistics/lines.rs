//! Lines in the spectrum of the electrode's motion: hunting and vibration.
//!
//! Segments of 1.024 s at 1 kHz, half overlapping, each freed of its straight line (the feed) and under a Hann window;
//! their power is averaged (Welch). The amplitude of a line is that of the sine with the power found in the bin and its
//! two neighbours, A = sqrt(4 sum |X|^2 / (N sum w^2)): right to 1 % wherever in the bin the line lies. Broadband
//! wandering of 3 Hz width counts in full, so the figure errs on the strict side.

use super::fourier::Fourier;

/// Samples in a segment, 1 ms each.
const SEGMENT: usize = 1024;
const BIN_HZ: f64 = 1000.0 / SEGMENT as f64;
/// Band that is searched, Hz: \[R\]'s machine hunted at 5 Hz and swung at 17 to 20 Hz.
const BAND_HZ: std::ops::RangeInclusive<f64> = 5.0..=50.0;

/// A line of the spectrum.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Line {
    /// Amplitude (half of peak-to-peak), um.
    pub amplitude_um: f64,
    /// Frequency, Hz.
    pub hz: f64,
}

/// Averages the spectrum of the monitored position.
#[derive(Debug)]
pub struct Lines {
    fourier: Fourier,
    window: Vec<f64>,
    position_um: Vec<f64>,
    input: Vec<f64>,
    power: Vec<f64>,
    segments: u32,
}

impl Lines {
    pub(super) fn new() -> Lines {
        let turn = std::f64::consts::TAU / SEGMENT as f64;
        Lines {
            window: (0..SEGMENT).map(|i| 0.5 - 0.5 * (turn * i as f64).cos()).collect(),
            position_um: Vec::with_capacity(SEGMENT),
            input: vec![0.0; SEGMENT],
            power: vec![0.0; SEGMENT / 2 + 1],
            segments: 0,
            fourier: Fourier::new(SEGMENT),
        }
    }

    /// Adds 1 ms of monitored position, um.
    pub(super) fn add(&mut self, position_um: f64) {
        self.position_um.push(position_um);
        if self.position_um.len() == SEGMENT {
            self.segment();
            self.position_um.drain(..SEGMENT / 2);
        }
    }

    /// What follows does not join what was added.
    pub(super) fn interrupt(&mut self) {
        self.position_um.clear();
    }

    fn segment(&mut self) {
        let line = trend(self.position_um.iter().copied());
        let moves = self.position_um.iter().zip(line).zip(&self.window);
        for (input, ((x, trend), weight)) in self.input.iter_mut().zip(moves) {
            *input = (x - trend) * weight;
        }
        let spectrum = self.fourier.transform(&self.input);
        for (power, (re, im)) in self.power.iter_mut().zip(spectrum) {
            *power += re * re + im * im;
        }
        self.segments += 1;
    }

    /// The line of the largest amplitude; `None` before the first segment.
    pub fn strongest(&self) -> Option<Line> {
        let scale = 4.0 / (f64::from(self.segments) * SEGMENT as f64 * self.window.iter().map(|w| w * w).sum::<f64>());
        let line = |(centre, bins): (usize, &[f64])| {
            let power: f64 = bins.iter().sum();
            let moment: f64 = bins.iter().zip([-1.0, 0.0, 1.0]).map(|(bin, offset)| bin * offset).sum();
            let offset = if power > 0.0 { moment / power } else { 0.0 };
            Line { amplitude_um: (scale * power).sqrt(), hz: (centre as f64 + offset) * BIN_HZ }
        };
        let around = self.power.windows(3).enumerate().map(|(low, bins)| (low + 1, bins));
        let band = around.filter(|(centre, _)| BAND_HZ.contains(&(*centre as f64 * BIN_HZ)));
        let strongest = band.map(line).max_by(|a, b| a.amplitude_um.total_cmp(&b.amplitude_um));
        strongest.filter(|_| self.segments > 0)
    }
}

/// The straight line of least squares through equidistant values, at each of them.
pub(super) fn trend(values: impl ExactSizeIterator<Item = f64> + Clone) -> impl Iterator<Item = f64> {
    let n = values.len() as f64;
    let centre = (n - 1.0) / 2.0;
    let mean = values.clone().sum::<f64>() / n;
    let slope =
        values.enumerate().map(|(i, x)| (i as f64 - centre) * (x - mean)).sum::<f64>() * 12.0 / (n * (n * n - 1.0));
    (0..).map(move |i| mean + slope * (f64::from(i) - centre))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ten seconds of a sine on a feed of 3 um/s.
    fn strongest(amplitude: f64, hz: f64) -> Line {
        let mut lines = Lines::new();
        for ms in 0..10_000 {
            let t = f64::from(ms) / 1000.0;
            lines.add(3.0 * t + amplitude * (std::f64::consts::TAU * hz * t).sin());
        }
        lines.strongest().unwrap()
    }

    #[test]
    fn a_line_is_found_with_its_amplitude_and_frequency_wherever_it_lies() {
        for hz in [5.86, 10.0, 17.6, 20.02, 33.3, 48.0] {
            let line = strongest(3.0, hz);
            assert!((line.amplitude_um / 3.0 - 1.0).abs() < 0.011, "{line:?} for {hz} Hz");
            assert!((line.hz - hz).abs() < 0.2, "{line:?} for {hz} Hz");
        }
    }

    #[test]
    fn feed_alone_and_motion_outside_the_band_are_no_lines() {
        assert!(strongest(0.0, 10.0).amplitude_um < 1e-6);
        assert!(strongest(10.0, 2.0).amplitude_um < 0.1);
        assert!(strongest(10.0, 60.0).amplitude_um < 0.01);
    }

    #[test]
    fn nothing_is_reported_without_a_whole_segment() {
        let mut lines = Lines::new();
        for i in 0..3 * SEGMENT {
            if i % (SEGMENT - 1) == 0 {
                lines.interrupt();
            }
            lines.add(i as f64);
        }
        assert_eq!(lines.strongest(), None);
    }

    #[test]
    fn the_trend_of_a_straight_line_is_itself() {
        let line = [1.0, 3.0, 5.0, 7.0];
        for (trend, x) in trend(line.into_iter()).zip(line) {
            assert!((trend - x).abs() < 1e-12);
        }
    }
}
