//! A light's settings as rows: every field there is, found by reflection, with its range.

use core::ops::RangeInclusive;

use bevy::reflect::{
    GetPath, NamedField, PartialReflect, ReflectRef, TypeInfo, UnnamedField,
    attributes::CustomAttributes,
    enums::{DynamicEnum, DynamicVariant, EnumInfo, VariantInfo},
    structs::DynamicStruct,
    tuple::DynamicTuple,
};
use bevy_pssm::{config::MIN_MAP_SIZE, prelude::*};

/// One field.
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    /// Where it is, as `reflect_path` has it.
    pub path: String,
    /// Its name, for people.
    pub label: String,
    /// Within how many others.
    pub depth: usize,
    /// What it holds.
    pub value: Value,
}

/// What a field holds.
#[derive(Debug, Clone, PartialEq)]
pub enum Value {
    /// A number.
    Number {
        /// Now.
        value: f32,
        /// What is allowed, if there are bounds.
        range: Option<RangeInclusive<f32>>,
        /// Without fractions.
        whole: bool,
    },
    /// One of several.
    Choice {
        /// By number.
        chosen: usize,
        /// Their names.
        names: &'static [&'static str],
    },
}

/// Larger than what sliders of numbers without bounds reach, and smaller.
const WIDEST: RangeInclusive<f32> = 0.01..=10_000.0;
/// Ends of ranges that are this many times apart have sliders of magnitudes.
const MAGNITUDES: f32 = 100.0;

/// How a number lies along a slider.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Track {
    start: f32,
    end: f32,
    whole: bool,
}

impl Track {
    /// For a number with these bounds.
    pub fn new(range: Option<&RangeInclusive<f32>>, whole: bool) -> Self {
        let (start, end) = range.map_or((*WIDEST.start(), *WIDEST.end()), |range| {
            (*range.start(), *range.end())
        });
        let huge = end > *WIDEST.end() && !whole;
        let (start, end) = if huge {
            (start.max(*WIDEST.start()), end.min(*WIDEST.end()))
        } else {
            (start, end)
        };
        Self { start, end, whole }
    }

    fn has_magnitudes(self) -> bool {
        self.start > 0.0 && self.end >= MAGNITUDES * self.start
    }

    /// Where a value is, 0 to 1.
    pub fn position(self, value: f32) -> f32 {
        let share = if self.has_magnitudes() {
            (value / self.start).max(f32::MIN_POSITIVE).ln() / (self.end / self.start).ln()
        } else {
            (value - self.start) / (self.end - self.start)
        };
        share.clamp(0.0, 1.0)
    }

    /// What is there, to three digits.
    pub fn value(self, position: f32) -> f32 {
        if self.has_magnitudes() {
            let value = self.start * (self.end / self.start).powf(position);
            return if self.whole {
                // In quarters of doublings.
                (0.25 * (4.0 * value.log2()).round()).exp2().round()
            } else {
                rounded(value, value)
            };
        }
        let value = self.start + position * (self.end - self.start);
        if self.whole {
            value.round()
        } else {
            rounded(value, self.end - self.start)
        }
    }

    /// By how much an arrow key moves.
    pub fn step(self) -> f32 {
        if self.has_magnitudes() && self.whole {
            0.25 / (self.end / self.start).log2()
        } else if self.whole {
            1.0 / (self.end - self.start).max(1.0)
        } else {
            0.01
        }
    }
}

/// To three digits of a size.
fn rounded(value: f32, size: f32) -> f32 {
    let digit = 10_f64.powf(f64::from(size.abs().max(1e-6)).log10().floor() - 2.0);
    ((f64::from(value) / digit).round() * digit) as f32
}

/// All fields of a light's settings.
pub fn rows(shadows: &ParallelSplitShadows) -> Vec<Row> {
    let mut rows = Vec::new();
    push_fields(&mut rows, shadows, "", 0);
    rows
}

/// Sets a number.
pub fn set_number(shadows: &mut ParallelSplitShadows, path: &str, value: f32) {
    if let Ok(field) = shadows.path_mut::<f32>(path) {
        *field = value;
    } else if let Ok(field) = shadows.path_mut::<u32>(path) {
        *field = value.round().max(0.0) as u32;
    }
    fill_lists(shadows);
}

/// Chooses a variant.
pub fn choose(shadows: &mut ParallelSplitShadows, path: &str, chosen: usize) {
    let field = shadows.reflect_path_mut(path).ok();
    if let Some(field) = field
        && let Some(info) = field.get_represented_type_info()
        && let Some(value) = variant(info, chosen)
    {
        // A variant of the same type always applies.
        let _ = field.try_apply(&value);
    }
    fill_lists(shadows);
}

/// Chooses the next variant.
pub fn choose_next(shadows: &mut ParallelSplitShadows, path: &str) {
    let chosen = match shadows.reflect_path(path).map(PartialReflect::reflect_ref) {
        Ok(ReflectRef::Enum(variant)) => variant.variant_index() + 1,
        _ => return,
    };
    let info = shadows.reflect_path(path).ok();
    let info = info.and_then(PartialReflect::get_represented_type_info);
    let count = info
        .and_then(|info| info.as_enum().ok())
        .map_or(1, EnumInfo::variant_len);
    choose(shadows, path, chosen % count.max(1));
}

/// Sets a field to its default. What the default does not have is left alone.
pub fn reset(shadows: &mut ParallelSplitShadows, path: &str) {
    let defaults = ParallelSplitShadows::default();
    if let (Ok(field), Ok(default)) = (shadows.reflect_path_mut(path), defaults.reflect_path(path))
    {
        let _ = field.try_apply(default);
    }
    fill_lists(shadows);
}

/// Whether a field is as it is by default.
pub fn is_default(shadows: &ParallelSplitShadows, path: &str) -> bool {
    let defaults = ParallelSplitShadows::default();
    match (shadows.reflect_path(path), defaults.reflect_path(path)) {
        (Ok(field), Ok(default)) => field.reflect_partial_eq(default).unwrap_or(true),
        _ => true,
    }
}

fn push_fields(rows: &mut Vec<Row>, value: &dyn PartialReflect, path: &str, depth: usize) {
    match value.reflect_ref() {
        ReflectRef::Struct(fields) => {
            let info = value.get_represented_type_info();
            for (index, (name, field)) in fields.iter_fields().enumerate() {
                let attributes = info
                    .and_then(|info| info.as_struct().ok()?.field_at(index))
                    .map(NamedField::custom_attributes);
                push(
                    rows,
                    field,
                    attributes,
                    format!("{path}.{name}"),
                    name,
                    depth,
                );
            }
        }
        ReflectRef::Enum(variant) => {
            let info = value.get_represented_type_info();
            let info = info.and_then(|info| info.as_enum().ok()?.variant(variant.variant_name()));
            for (index, field) in variant.iter_fields().enumerate() {
                let (name, attributes) = match info {
                    Some(VariantInfo::Struct(info)) => {
                        let field = info.field_at(index);
                        let name = field.map_or("", NamedField::name);
                        (name, field.map(NamedField::custom_attributes))
                    }
                    Some(VariantInfo::Tuple(info)) => {
                        let field = info.field_at(index);
                        ("", field.map(UnnamedField::custom_attributes))
                    }
                    _ => ("", None),
                };
                let (step, label) = if name.is_empty() {
                    (index.to_string(), variant.variant_name())
                } else {
                    (name.to_owned(), name)
                };
                push(
                    rows,
                    field.value(),
                    attributes,
                    format!("{path}.{step}"),
                    label,
                    depth,
                );
            }
        }
        ReflectRef::List(list) => {
            for (index, item) in list.iter().enumerate() {
                let label = (index + 1).to_string();
                push(rows, item, None, format!("{path}[{index}]"), &label, depth);
            }
        }
        ReflectRef::Array(array) => {
            for (index, item) in array.iter().enumerate() {
                let label = ["width", "height"].get(index).copied().unwrap_or_default();
                push(rows, item, None, format!("{path}[{index}]"), label, depth);
            }
        }
        _ => {}
    }
}

fn push(
    rows: &mut Vec<Row>,
    field: &dyn PartialReflect,
    attributes: Option<&CustomAttributes>,
    path: String,
    label: &str,
    depth: usize,
) {
    let label = label.replace('_', " ");
    let number = |value: f32, range, whole| Value::Number {
        value,
        range,
        whole,
    };
    let value = if let Some(value) = field.try_downcast_ref::<f32>() {
        let range = attributes.and_then(|it| it.get::<RangeInclusive<f32>>());
        Some(number(*value, range.cloned(), false))
    } else if let Some(value) = field.try_downcast_ref::<u32>() {
        let range = attributes.and_then(|it| it.get::<RangeInclusive<u32>>());
        let range = range.map(|range| *range.start() as f32..=*range.end() as f32);
        Some(number(*value as f32, range, true))
    } else if let ReflectRef::Enum(variant) = field.reflect_ref() {
        let info = field.get_represented_type_info();
        let info = info.and_then(|info| info.as_enum().ok());
        info.map(|info| Value::Choice {
            chosen: variant.variant_index(),
            names: info.variant_names(),
        })
    } else {
        None
    };
    let is_group = value.is_none();
    if let Some(value) = value {
        rows.push(Row {
            path: path.clone(),
            label,
            depth,
            value,
        });
    }
    push_fields(rows, field, &path, depth + usize::from(!is_group));
}

/// A variant with values that a game might begin with.
fn variant(info: &TypeInfo, chosen: usize) -> Option<DynamicEnum> {
    let info = info.as_enum().ok()?.variant_at(chosen)?;
    let fields = match info {
        VariantInfo::Unit(_) => DynamicVariant::Unit,
        VariantInfo::Tuple(tuple) => {
            let mut fields = DynamicTuple::default();
            for field in tuple.iter() {
                fields.insert_boxed(first_value(info.name(), field.type_info()?)?);
            }
            DynamicVariant::Tuple(fields)
        }
        VariantInfo::Struct(named) => {
            let mut fields = DynamicStruct::default();
            for field in named.iter() {
                fields.insert_boxed(field.name(), first_value(field.name(), field.type_info()?)?);
            }
            DynamicVariant::Struct(fields)
        }
    };
    Some(DynamicEnum::new(info.name(), fields))
}

/// What a field of a variant that was just chosen holds. `name` is its own, or else its variant's.
fn first_value(name: &str, info: &TypeInfo) -> Option<Box<dyn PartialReflect>> {
    let number = match name {
        "lambda" => 0.9,
        "Texels" if info.is::<u32>() => 4_194_304.0,
        "gamma" | "Texels" => 2.0,
        "focus" => 0.3,
        "sharpness" | "Strength" => 0.5,
        "sun_degrees" => 0.53,
        "Same" => 2048.0,
        "Halving" => 4096.0,
        "Budget" => 16_777_216.0,
        "Meters" | "meters" => 0.05,
        "bias" | "factor" | "texels" | "Maps" => 1.0,
        _ => 0.0,
    };
    Some(match info {
        info if info.is::<f32>() => Box::new(number as f32),
        info if info.is::<u32>() => Box::new(number as u32),
        info if info.is::<Vec<f32>>() => Box::new(Vec::<f32>::new()),
        info if info.is::<Vec<MapFit>>() => Box::new(Vec::<MapFit>::new()),
        info if info.is::<Vec<[u32; 2]>>() => Box::new(Vec::<[u32; 2]>::new()),
        TypeInfo::Enum(_) => Box::new(variant(info, 0)?),
        _ => return None,
    })
}

/// Lists with an entry for each cascade have as many as there are cascades.
fn fill_lists(shadows: &mut ParallelSplitShadows) {
    let cascades = shadows.cascades.clamp(1, 4) as usize;
    if let CascadeFit::PerCascade(fits) = &mut shadows.fit {
        fits.resize(cascades, MapFit::Steady);
    }
    if let MapSize::PerCascade(sizes) = &mut shadows.map_size {
        sizes.resize(cascades, [2048.max(MIN_MAP_SIZE); 2]);
    }
    let (near, far) = (shadows.near, shadows.far);
    if let SplitScheme::Manual(planes) = &mut shadows.splits
        && planes.len() != cascades - 1
    {
        *planes = (1..cascades)
            .map(|index| near * (far / near).powf(index as f32 / cascades as f32))
            .collect();
    }
}
