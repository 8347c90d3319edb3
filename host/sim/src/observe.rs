//! One sample per tick, for figures, trace and plot.

use crate::millisecond::Gatherer;
use crate::output::Output;
use crate::plot::Picture;
use crate::run::{Job, Observer, Outcome, Progress, Sample};
use crate::statistics::Statistics;
use crate::trace::Trace;

/// Makes a run: [`crate::bore::bore`], or in tests a machine with a known outcome.
pub trait Run: Fn(&Job, &mut Recorder, &mut dyn FnMut(&Progress)) -> Result<Outcome, String> {}

impl<F: Fn(&Job, &mut Recorder, &mut dyn FnMut(&Progress)) -> Result<Outcome, String>> Run for F {}

/// Collects the outputs of a run.
#[derive(Debug)]
pub struct Recorder {
    gatherer: Gatherer,
    /// Figures of the run.
    pub statistics: Statistics,
    /// Table of the run, if requested.
    pub trace: Option<Trace>,
    /// Picture of the run, if requested.
    pub picture: Option<Picture>,
}

impl Recorder {
    /// Gathers figures always, a trace if there is an output for it, what a picture needs if one is wanted.
    pub fn new(trace: Option<&Output>, picture: bool) -> Result<Recorder, String> {
        Ok(Recorder {
            gatherer: Gatherer::default(),
            statistics: Statistics::new(),
            trace: trace.map(Trace::new).transpose()?,
            picture: picture.then(Picture::default),
        })
    }
}

impl Observer for Recorder {
    fn sample(&mut self, sample: &Sample) {
        if let Some(trace) = &mut self.trace {
            trace.sample(sample);
        }
        if let Some(millisecond) = self.gatherer.add(sample) {
            self.statistics.add(&millisecond);
            if let Some(picture) = &mut self.picture {
                picture.add(&millisecond);
            }
        }
    }
}
