//! What is wrong with a side's picture, and the marks that show it.

use super::{
    super::probe::{Shares, Subject},
    CLEAR, SideResult,
    rays::Pass,
};
use crate::truth::accuracy::{Accuracy, Fault};

const LEAK: [u8; 4] = [230, 60, 40, 255];
const ACNE: [u8; 4] = [40, 110, 255, 255];
const STAIN: [u8; 4] = [240, 200, 40, 255];

/// What is wrong with the sides' pictures.
pub(super) struct Judgement {
    pub(super) subject: Subject,
    /// No pixel is left out.
    pub(super) is_final: bool,
    pub(super) sides: [Option<Verdict>; 2],
}

pub(super) struct Verdict {
    pub(super) result: SideResult,
    /// As an image's bytes.
    pub(super) marks: Vec<u8>,
}

impl Judgement {
    pub(super) fn new(pass: &Pass, shares: &Shares) -> Self {
        let [left, right] = &shares.sides;
        Self {
            subject: shares.subject.clone(),
            is_final: pass.stride == 1,
            sides: [left, right].map(|shares| Verdict::new(pass, shares.as_ref()?)),
        }
    }
}

impl Verdict {
    /// How far a pixel is from the edges of shadows is known only once all are traced: no stains
    /// until then. `None` if the picture is of another size.
    pub(super) fn new(pass: &Pass, shares: &[Option<f32>]) -> Option<Self> {
        let truth = &pass.truth;
        if shares.len() != truth.samples.len() {
            return None;
        }
        let mut accuracy = Accuracy::default();
        accuracy.add(truth, shares);
        let mut figures = accuracy.figures();
        let has_stains = pass.stride == 1;
        if !has_stains {
            figures.stain_pct = 0.0;
        }
        let fault = |(pixel, share): (usize, &Option<f32>)| {
            let fault = share.and_then(|share| truth.fault(pixel, share));
            let counts = |fault: &Fault| has_stains || *fault != Fault::Stain;
            fault.filter(counts).unwrap_or(Fault::None)
        };
        let faults: Vec<Fault> = shares.iter().enumerate().map(fault).collect();
        let marks = marks_of(&faults, truth.size().x as usize, pass.stride);
        Some(Self {
            result: SideResult { figures, faults },
            marks,
        })
    }
}

/// Each pixel that has been traced stands for those after it.
fn marks_of(faults: &[Fault], width: usize, stride: usize) -> Vec<u8> {
    let mark = |pixel: usize| {
        let (x, y) = (pixel % width, pixel / width);
        let traced = (y - y % stride) * width + x - x % stride;
        match faults[traced] {
            Fault::None => CLEAR,
            Fault::Acne => ACNE,
            Fault::Leak => LEAK,
            Fault::Stain => STAIN,
        }
    };
    (0..faults.len()).flat_map(mark).collect()
}
