//! Figures as text.

use bevy_pssm::plan::Redraw;

use super::super::sides::{Compare, Side, Technique};
use super::{CascadeFigures, Counters, Figures, MapState, PassFigures, SideFigures};

/// Characters of a line.
const LINE: usize = 44;

impl Counters {
    /// The figures, for a font whose characters are all equally wide: at most 16 lines of 44.
    pub fn text(&self, compare: &Compare) -> String {
        let Figures { frame, main, .. } = self.shown;
        let pace = if frame > 0.0 { 1e3 / frame } else { 0.0 };
        let main = or_dash(main, |main| format!("{main:.2}"));
        let mib = self.shown.bytes as f64 / f64::from(1 << 20);
        let mut lines = vec![
            format!("{pace:.1} fps  {frame:.2} ms   main {main} ms GPU"),
            format!(
                "maps {mib:.1} MiB   plan and cull {:.2} ms CPU",
                self.planning
            ),
        ];
        for side in Side::BOTH {
            if side == Side::Left || compare.wipe.is_some() {
                let name = name_of(side, compare.techniques[side.index()]);
                lines.extend(self.shown.sides[side.index()].lines(&name));
            }
        }
        let cut = |line: &String| line.chars().take(LINE).collect::<String>();
        lines.iter().map(cut).collect::<Vec<_>>().join("\n")
    }
}

fn name_of(side: Side, technique: Technique) -> String {
    let side = match side {
        Side::Left => "left",
        Side::Right => "right",
    };
    let technique = match technique {
        Technique::Plugin => "plugin",
        Technique::BuiltIn => "Bevy",
        Technique::Tuned => "tuned",
    };
    format!("{side} {technique}")
}

impl MapState {
    fn word(self) -> &'static str {
        match self {
            Self::Missing => "-",
            Self::Held => "held",
            Self::BuiltIn | Self::Drawn(Redraw::EveryFrame) => "always",
            Self::Drawn(Redraw::New) => "new",
            Self::Drawn(Redraw::Light) => "light",
            Self::Drawn(Redraw::Size) => "size",
            Self::Drawn(Redraw::Moved) => "moved",
            Self::Drawn(Redraw::Casters) => "casters",
            Self::Drawn(Redraw::Added) => "added",
        }
    }
}

impl SideFigures {
    fn lines(&self, name: &str) -> Vec<String> {
        if self.cascades.is_empty() {
            return vec![format!("{name}: no maps")];
        }
        let row = |label: &str, cell: fn(&CascadeFigures) -> String| {
            let cells = self.cascades.iter().map(cell);
            let cells = cells.map(|cell| format!("{cell:>8}"));
            format!("{label:<12}{}", cells.collect::<String>())
        };
        let drawn = format!("drawn {:.1}", self.drawn);
        let mut lines = vec![
            row(name, |it| format!("<{:.0} m", it.far)),
            row("casters", |it| match it.moving {
                0 => it.casters.to_string(),
                moving => format!("{}+{moving}", it.casters),
            }),
            row(&drawn, |it| it.map.word().to_owned()),
            row("texels/pixel", |it| {
                or_dash(it.texels_per_pixel, |texels| format!("{texels:.2}"))
            }),
            row("texel", |it| or_dash(it.texel, length)),
        ];
        lines.extend(self.passes.map(PassFigures::line));
        lines
    }
}

impl PassFigures {
    fn line(self) -> String {
        let time = or_dash(self.milliseconds, |time| format!("{time:.2}"));
        let vertices = or_dash(self.vertices, short);
        let primitives = or_dash(self.primitives, short);
        format!("{time:>6} ms {vertices:>6} vertices {primitives:>6} primitives")
    }
}

fn or_dash(value: Option<f64>, write: impl Fn(f64) -> String) -> String {
    value.map_or_else(|| "-".to_owned(), write)
}

/// A count in at most five characters.
fn short(count: f64) -> String {
    if count >= 1e7 {
        format!("{:.0}M", count / 1e6)
    } else if count >= 1e4 {
        format!("{:.0}k", count / 1e3)
    } else {
        format!("{count:.0}")
    }
}

fn length(meters: f64) -> String {
    if meters >= 1.0 {
        format!("{meters:.2} m")
    } else {
        format!("{:.1} cm", 100.0 * meters)
    }
}
