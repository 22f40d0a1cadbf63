//! Decides, field by field, what the columns of a source become: [`super::plan`].

use super::colours;
use super::column::{Column, FieldPlan, HALVES, RGB, Writer};
use super::names::{self, ALPHA, CLASS_FLAGS, Meaning, meaning};
use super::recipe::{Bits, Recipe};
use super::values::{ANGLE_STEP, Values};
use crate::text::naming::schema_of;
use esker_points::AttrType;
use esker_points::attribute::names as esker;
use std::collections::HashSet;
use std::sync::Arc;

/// Greatest distance of an angle from a step, in degrees: singles are within 0.00002.
const OFF_ANGLE_MAX: f64 = 1e-4;

/// Seconds of a week, beyond which GPS times are no seconds of one.
const WEEK_S: f64 = 604_800.0;

/// An attribute to be.
struct Made {
    name: String,
    ty: AttrType,
    recipe: Recipe,
}

pub(super) struct Planner<'a> {
    columns: &'a [Column<'a>],
    writer: Writer,
    /// Meaning of each column that has none yet made of it; one column for each meaning.
    meanings: Vec<Option<Meaning>>,
    used: Vec<bool>,
    made: Vec<Made>,
    /// Columns that are read as a field under another name or in another form.
    read_as: Vec<String>,
    /// Columns whose values do not fit their field.
    unfit: Vec<String>,
    notes: Vec<String>,
    are_colours_full: bool,
    colour_max: u16,
}

impl<'a> Planner<'a> {
    pub(super) fn new(columns: &'a [Column<'a>], writer: Writer) -> Self {
        let mut meanings: Vec<Option<Meaning>> = columns.iter().map(|c| meaning(c.name)).collect();
        // One column for each meaning: the one that has Esker's name for it, else the first.
        let mut taken = HashSet::new();
        let is_exact =
            |i: usize| matches!(meanings[i], Some(Meaning::Field(name)) if name == columns[i].name);
        let (exact, others): (Vec<usize>, Vec<usize>) =
            (0..columns.len()).partition(|&i| is_exact(i));
        for i in exact.into_iter().chain(others) {
            if meanings[i].is_some_and(|m| !taken.insert(m)) {
                meanings[i] = None;
            }
        }
        Self {
            columns,
            writer,
            meanings,
            used: vec![false; columns.len()],
            made: Vec::new(),
            read_as: Vec::new(),
            unfit: Vec::new(),
            notes: Vec::new(),
            are_colours_full: false,
            colour_max: 0,
        }
    }

    fn find(&self, meaning: Meaning) -> Option<usize> {
        self.meanings.iter().position(|m| *m == Some(meaning))
    }

    fn find_field(&self, name: &'static str) -> Option<usize> {
        self.find(Meaning::Field(name))
    }

    fn make(&mut self, name: &str, ty: AttrType, recipe: Recipe) {
        self.made.push(Made { name: name.to_owned(), ty, recipe });
    }

    fn has(&self, name: &str, ty: AttrType) -> bool {
        self.made.iter().any(|m| m.name == name && m.ty == ty)
    }

    /// Makes a field of a type of the numbers of one column.
    fn take(&mut self, column: usize, name: &str, ty: AttrType) {
        let recipe = match self.columns[column].ty {
            Some(own) if own == ty => Recipe::Same(column),
            own => {
                if own.is_some() {
                    self.read_as.push(format!("{name} ({})", self.columns[column].name));
                }
                Recipe::Number(column)
            }
        };
        self.used[column] = true;
        self.make(name, ty, recipe);
    }

    /// Leaves a column an attribute of its own, since its values do not fit the field.
    fn leave(&mut self, column: usize) {
        self.unfit.push(self.columns[column].name.to_owned());
        self.meanings[column] = None;
    }

    /// Joins pairs of 32-bit integers that Esker wrote for 64-bit ones.
    pub(super) fn join_halves(&mut self) {
        let [low_end, high_end] = HALVES;
        for low in 0..self.columns.len() {
            let Some(base) = self.columns[low].name.strip_suffix(low_end) else { continue };
            let is_high = |c: &Column<'_>| c.name.strip_suffix(high_end) == Some(base);
            let Some(high) = self.columns.iter().position(is_high) else { continue };
            let ty = match (self.columns[low].ty, self.columns[high].ty) {
                (Some(AttrType::U32), Some(AttrType::U32)) => AttrType::U64,
                (Some(AttrType::U32), Some(AttrType::I32)) => AttrType::I64,
                _ => continue,
            };
            self.used[low] = true;
            self.used[high] = true;
            self.make(base, ty, Recipe::Halves { low, high });
            self.read_as.push(format!("{base} ({base}{low_end}, {base}{high_end})"));
        }
    }

    /// Red, green and blue are colours only if all three exist, alpha only beside them.
    pub(super) fn colours(&mut self) {
        let found = RGB.map(|name| self.find_field(name));
        let alpha = self.find_field(ALPHA);
        let scale = match found {
            [Some(r), Some(g), Some(b)] => {
                let rgb = [r, g, b];
                colours::scale(rgb.map(|c| &self.columns[c])).map(|scale| (rgb, scale))
            }
            _ => None,
        };
        let Some((rgb, scale)) = scale else {
            if found.iter().all(Option::is_some) {
                self.notes.push(
                    "red, green and blue have values below 0 or above 65,535: they are attributes, no colours".into(),
                );
            }
            for column in found.into_iter().flatten().chain(alpha) {
                self.meanings[column] = None;
            }
            return;
        };
        let recipe = |column: usize, own: Option<AttrType>| match own {
            Some(own) if own == scale.ty => Recipe::Same(column),
            _ if scale.is_full => Recipe::Colour { column, factor: scale.factor },
            _ => Recipe::Number(column),
        };
        for (name, column) in RGB.into_iter().zip(rgb) {
            self.used[column] = true;
            let recipe = recipe(column, self.columns[column].ty);
            self.make(name, scale.ty, recipe);
        }
        let is_wide = scale.ty == AttrType::U16;
        self.are_colours_full = scale.is_full && is_wide;
        let greatest = rgb.map(|c| self.columns[c].values.max).into_iter().fold(0.0, f64::max);
        self.colour_max = match (is_wide, scale.is_full) {
            (false, _) => 0,
            (true, true) => u16::MAX,
            (true, false) => greatest as u16,
        };
        self.notes.extend(scale.note);
        let Some(column) = alpha else { return };
        let Column { ty, values, .. } = self.columns[column];
        let made = match ty {
            Some(ty @ (AttrType::U8 | AttrType::U16)) => Some((ty, Recipe::Same(column))),
            _ if scale.is_full
                && values.min >= 0.0
                && values.max * scale.factor <= top(scale.ty) =>
            {
                Some((scale.ty, Recipe::Colour { column, factor: scale.factor }))
            }
            _ if values.is_whole_within(0.0, top(scale.ty)) => {
                Some((scale.ty, Recipe::Number(column)))
            }
            _ => None,
        };
        match made {
            Some((ty, recipe)) => {
                self.used[column] = true;
                self.make(ALPHA, ty, recipe);
            }
            None => self.meanings[column] = None,
        }
    }

    /// `returns` and `flags`: as bytes of Esker, or from their parts.
    pub(super) fn packed(&mut self) {
        let whole = |planner: &Self, name: &'static str| {
            let column = planner.find_field(name)?;
            let Column { ty, values, name: own, .. } = planner.columns[column];
            let fits = own == name
                && ty.is_none_or(|ty| ty == AttrType::U8)
                && values.is_whole_within(0.0, 255.0);
            fits.then_some(column)
        };
        let (returns, flags) = (whole(self, esker::RETURNS), whole(self, esker::FLAGS));
        // A count of returns may have the same name, so the values decide, and flags beside them
        // or the order of columns.
        let is_sure = |&column: &usize| {
            let Column { ty, values, .. } = self.columns[column];
            let is_counted = values.bits & 0xf0 != 0 || values.bits == 0;
            let is_typical = values.are_returns && values.is_any();
            match self.writer {
                Writer::Esker => true,
                _ if flags.is_some() => is_counted,
                Writer::PerhapsEsker => is_typical || is_counted && !values.has_uncounted,
                Writer::Any if ty.is_some() => is_counted && !values.has_uncounted,
                Writer::Any => is_typical,
            }
        };
        let returns = returns.filter(is_sure);
        let has_other_returns =
            returns.is_none() && self.columns.iter().any(|c| c.name == esker::RETURNS);
        let are_flags_sure = match self.writer {
            Writer::Esker => true,
            Writer::PerhapsEsker => !has_other_returns,
            Writer::Any => returns.is_some(),
        };
        let flags = flags.filter(|_| are_flags_sure);
        if self.writer != Writer::Esker && returns.is_some() != flags.is_some() {
            let alone = if returns.is_some() { esker::RETURNS } else { esker::FLAGS };
            self.notes.push(format!(
                "`{alone}` is read as the byte of LAS, as Esker writes it; if it is none, name it otherwise"
            ));
        }
        for (name, column) in [(esker::RETURNS, returns), (esker::FLAGS, flags)] {
            match column {
                Some(column) => self.take(column, name, AttrType::U8),
                None => self.pack(name),
            }
        }
    }

    /// Makes a packed byte from its parts, if there are any and all fit.
    fn pack(&mut self, whole: &'static str) {
        let parts = |planner: &Self| -> Vec<(usize, names::Part)> {
            let all = planner.meanings.iter().enumerate();
            let parts = all.filter_map(|(column, m)| match m {
                Some(Meaning::Part(part)) if part.whole == whole => Some((column, *part)),
                _ => None,
            });
            parts.collect()
        };
        // The four class flags in one number beside single ones: only the single ones count.
        if let Some(column) = self.find(CLASS_FLAGS) {
            let is_single = |(_, part): &(usize, names::Part)| part.shift < 4 && part.bits == 1;
            if parts(self).iter().any(is_single) {
                self.meanings[column] = None;
            }
        }
        let is_unfit = |planner: &Self, &(column, part): &(usize, names::Part)| {
            let most = f64::from((1u32 << part.bits) - 1);
            !planner.columns[column].values.is_whole_within(0.0, most)
        };
        let unfit: Vec<usize> =
            parts(self).iter().filter(|p| is_unfit(self, p)).map(|(column, _)| *column).collect();
        unfit.into_iter().for_each(|column| self.leave(column));
        let parts = parts(self);
        if parts.is_empty() {
            return;
        }
        let mut names = Vec::new();
        for &(column, _) in &parts {
            self.used[column] = true;
            names.push(self.columns[column].name);
        }
        self.read_as.push(format!("{whole} ({})", names.join(", ")));
        let bits = parts.iter().map(|&(column, part)| Bits { column, shift: part.shift });
        self.make(whole, AttrType::U8, Recipe::Packed(bits.collect()));
    }

    /// Scan angles: whole degrees, or steps of 0.006 degrees.
    pub(super) fn angles(&mut self) {
        for meaning in [Meaning::Angle, Meaning::OtherAngle] {
            let Some(column) = self.find(meaning) else { continue };
            let Column { name, ty, values, .. } = self.columns[column];
            let is_rank = values.is_whole_within(f64::from(i8::MIN), f64::from(i8::MAX));
            let greatest = values.max.max(-values.min);
            let steps = i16::MIN.into()..=i16::MAX.into();
            let is_held = |degrees: f64| steps.contains(&(degrees / ANGLE_STEP).round());
            let is_steps = values.not_finite == 0
                && values.off_angle <= OFF_ANGLE_MAX
                && (!values.is_any() || is_held(values.min) && is_held(values.max));
            let is_las = [esker::RETURNS, esker::FLAGS].iter().all(|n| self.has(n, AttrType::U8));
            let is_esker = meaning == Meaning::Angle;
            if is_esker && is_las && ty == Some(AttrType::I16) {
                self.take(column, esker::SCAN_ANGLE, AttrType::I16);
            } else if is_rank && !(is_esker && is_steps && ty.is_none_or(is_floating)) {
                self.take(column, esker::SCAN_ANGLE_RANK, AttrType::I8);
            } else if is_steps {
                self.used[column] = true;
                self.make(esker::SCAN_ANGLE, AttrType::I16, Recipe::Angle(column));
                if !(is_esker && is_las) {
                    self.read_as.push(format!("scan_angle ({name}), in steps of 0.006 degrees"));
                }
            } else if greatest > 180.0
                && values.is_whole_within(f64::from(i16::MIN), i16::MAX.into())
            {
                self.take(column, esker::SCAN_ANGLE, AttrType::I16);
                self.notes.push(format!(
                    "`{name}` has whole numbers beyond 180: they are taken for steps of 0.006 degrees"
                ));
            } else {
                self.leave(column);
            }
        }
    }

    /// Fields that one column holds.
    pub(super) fn fields(&mut self) {
        let of_las = [
            esker::CLASSIFICATION,
            esker::USER_DATA,
            esker::POINT_SOURCE_ID,
            esker::RETURNS,
            esker::FLAGS,
            esker::SCAN_ANGLE,
            esker::SCAN_ANGLE_RANK,
        ];
        for column in 0..self.columns.len() {
            let Some(Meaning::Field(name)) = self.meanings[column].filter(|_| !self.used[column])
            else {
                continue;
            };
            let Column { ty, values, .. } = self.columns[column];
            // Values of the type of the field fit, and no pass is made over them.
            let whole = |field: AttrType| {
                (ty == Some(field) || values.is_whole_within(0.0, top(field))).then_some(field)
            };
            let wanted = match name {
                esker::CLASSIFICATION | esker::USER_DATA | esker::WAVE_DESCRIPTOR => {
                    whole(AttrType::U8)
                }
                esker::POINT_SOURCE_ID | esker::NIR => whole(AttrType::U16),
                esker::GPS_TIME => Some(AttrType::F64),
                esker::WAVE_SIZE => whole(AttrType::U32),
                esker::WAVE_OFFSET => match ty {
                    Some(AttrType::U64) => ty,
                    _ if values.narrowest() == AttrType::U64 => Some(AttrType::U64),
                    _ => values.is_whole_within(0.0, EXACT_MAX).then_some(AttrType::U64),
                },
                // Singles in LAS, and in text the fewest digits of singles.
                esker::WAVE_RETURN_POINT | esker::WAVE_X_T | esker::WAVE_Y_T | esker::WAVE_Z_T => {
                    ty.is_none_or(|ty| ty == AttrType::F32).then_some(AttrType::F32)
                }
                // The renderer draws normals of singles; text has no type.
                esker::NX | esker::NY | esker::NZ if ty.is_none_or(is_floating) => {
                    Some(ty.unwrap_or(AttrType::F32))
                }
                _ => continue,
            };
            let text_rounds = ty.is_none() && wanted == Some(AttrType::F32);
            match wanted {
                Some(wanted) if text_rounds => {
                    self.used[column] = true;
                    self.make(name, wanted, Recipe::Rounded(column));
                }
                Some(wanted) => self.take(column, name, wanted),
                None => self.leave(column),
            }
        }
        let Some(column) = self.find_field(esker::INTENSITY) else { return };
        // Intensities keep their type, so that files of one sensor have one type. Programs that
        // write fields of LAS as singles are the exception.
        let is_las = of_las.iter().any(|n| self.made.iter().any(|m| m.name == *n));
        let Column { ty, values, .. } = self.columns[column];
        let fits = values.is_whole_within(0.0, top(AttrType::U16));
        match ty {
            Some(own) if !(is_las && fits) => self.take(column, esker::INTENSITY, own),
            Some(AttrType::U8) => self.take(column, esker::INTENSITY, AttrType::U8),
            _ if fits => self.take(column, esker::INTENSITY, AttrType::U16),
            _ => self.take(column, esker::INTENSITY, values.narrowest()),
        }
    }

    /// All other columns, under their own names.
    pub(super) fn own(&mut self) {
        for column in 0..self.columns.len() {
            if self.used[column] {
                continue;
            }
            let Column { name, ty, values, type_with_gaps } = self.columns[column];
            let recipe = if ty.is_some() { Recipe::Same(column) } else { Recipe::Number(column) };
            let gaps = type_with_gaps.filter(|_| meaning(name).is_none());
            let ty = ty.or(gaps).unwrap_or_else(|| values.narrowest());
            // Under these names and types, values mean something else.
            let is_reserved = matches!(
                (name, ty),
                (esker::RETURNS | esker::FLAGS, AttrType::U8)
                    | (esker::SCAN_ANGLE, AttrType::I16)
                    | (esker::SCAN_ANGLE_RANK, AttrType::I8)
            );
            if is_reserved {
                let is_count = name == esker::RETURNS && values.has_uncounted;
                let why = if is_count { ", whose values have a number of returns" } else { "" };
                self.notes.push(format!(
                    "`{name}` is not the field of LAS{why}: it is kept as `{name}_`"
                ));
            }
            self.make(&format!("{name}{}", if is_reserved { "_" } else { "" }), ty, recipe);
        }
    }

    pub(super) fn finish(mut self) -> FieldPlan {
        let is_legacy = self.is_legacy();
        let are_times_beyond_week = self.are_times_beyond_week();
        let is_las = [esker::RETURNS, esker::FLAGS].iter().all(|n| self.has(n, AttrType::U8));
        let typed = self.made.iter().map(|m| (m.name.clone(), m.ty)).collect();
        let (mut schema, columns) = schema_of(typed);
        let mut recipes = vec![Recipe::Same(0); columns.len()];
        for (made, column) in self.made.into_iter().zip(columns) {
            recipes[column] = made.recipe;
        }
        // In LAS schemas, which have `returns` and `flags`, this scale is implied.
        if let (false, Some(angle)) = (is_las, schema.find_typed(esker::SCAN_ANGLE, AttrType::I16))
        {
            Arc::make_mut(&mut schema).attributes[angle].scale = ANGLE_STEP;
        }
        if !self.read_as.is_empty() {
            self.notes.push(format!("read as: {}", self.read_as.join(", ")));
        }
        if !self.unfit.is_empty() {
            self.notes.push(format!(
                "values do not fit the field of LAS of that name, and are kept as attributes: {}",
                self.unfit.join(", ")
            ));
        }
        FieldPlan {
            schema,
            recipes,
            notes: self.notes,
            are_colours_full: self.are_colours_full,
            colour_max: self.colour_max,
            is_legacy,
            are_times_beyond_week,
        }
    }

    fn are_times_beyond_week(&self) -> bool {
        let times = self.made.iter().filter(|m| m.name == esker::GPS_TIME && m.ty == AttrType::F64);
        times.into_iter().any(|m| match m.recipe {
            Recipe::Same(c) | Recipe::Number(c) => {
                let Values { min, max, .. } = self.columns[c].values;
                min.is_finite() && max.is_finite() && (min < 0.0 || max > WEEK_S)
            }
            _ => false,
        })
    }

    /// Whether the fields of point formats 0 to 5 hold all values, and whole degrees need them.
    fn is_legacy(&self) -> bool {
        let has = |name: &str| self.made.iter().any(|m| m.name == name);
        let bits_of = |name: &str| {
            let made = self.made.iter().filter(|m| m.name == name);
            made.fold(0u8, |bits, m| match &m.recipe {
                Recipe::Same(c) | Recipe::Number(c) => bits | self.columns[*c].values.bits,
                Recipe::Packed(parts) => parts.iter().fold(bits, |bits, part| {
                    bits | self.columns[part.column].values.bits << part.shift
                }),
                _ => u8::MAX,
            })
        };
        has(esker::SCAN_ANGLE_RANK)
            && !has(esker::SCAN_ANGLE)
            && !has(esker::NIR)
            && bits_of(esker::RETURNS) & 0x88 == 0
            && bits_of(esker::FLAGS) & 0x38 == 0
            && bits_of(esker::CLASSIFICATION) & 0xe0 == 0
    }
}

/// Whole numbers up to here are exact in `f64`.
const EXACT_MAX: f64 = (1u64 << 53) as f64 - 1.0;

/// The greatest number of an unsigned type.
fn top(ty: AttrType) -> f64 {
    match ty {
        AttrType::U8 => f64::from(u8::MAX),
        AttrType::U16 => f64::from(u16::MAX),
        _ => f64::from(u32::MAX),
    }
}

fn is_floating(ty: AttrType) -> bool {
    matches!(ty, AttrType::F32 | AttrType::F64)
}
