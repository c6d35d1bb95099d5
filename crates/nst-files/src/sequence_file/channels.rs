//! Which channels of a sequence file are what.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::Path,
};

use exr::prelude::SampleType;
use nst_core::{FurtherPowers, Power, Side};

use super::{info::term_name, power_state};
use crate::{ColorModel, Error, layers::channel_name, rows::RowReader};

/// The channels of a file: index and type, by name.
pub(super) struct Channels<'a> {
    path: &'a Path,
    by_name: BTreeMap<String, (usize, SampleType)>,
}

impl<'a> Channels<'a> {
    pub(super) fn of(path: &'a Path, rows: &RowReader) -> Self {
        let channels = rows.channels().enumerate();
        Self { path, by_name: channels.map(|(i, (name, kind))| (name, (i, kind))).collect() }
    }

    pub(super) fn model(&self) -> ColorModel {
        let has = |name| self.by_name.contains_key(name);
        if has("R") || !has("Y") { ColorModel::Rgb } else { ColorModel::Mono }
    }

    pub(super) fn has_layer(&self, layer: &str, model: ColorModel) -> bool {
        let mut names = model.channels().iter().map(|channel| channel_name(layer, channel));
        names.all(|name| self.by_name.contains_key(&name))
    }

    /// The further powers whose sums a state has.
    pub(super) fn powers(&self, model: ColorModel) -> FurtherPowers {
        let has_layer = |layer: &str| self.has_layer(layer, model);
        let powers = Power::all().filter(|&power| power_state::is_of(power, has_layer));
        FurtherPowers::of(&powers.collect::<Vec<_>>())
    }

    pub(super) fn find(&self, name: &str, kind: SampleType) -> Result<usize, Error> {
        match self.by_name.get(name) {
            Some(&(index, found)) if found == kind => Ok(index),
            Some(_) => Err(Error::malformed(
                self.path,
                format!("channel '{name}' is not of type {kind:?}"),
            )),
            None => Err(Error::malformed(self.path, format!("channel '{name}' is missing"))),
        }
    }

    fn layer(&self, channels: &[&str], layer: &str) -> Result<Vec<usize>, Error> {
        let names = channels.iter().map(|channel| channel_name(layer, channel));
        names.map(|name| self.find(&name, SampleType::F32)).collect()
    }

    /// The channels of the terms, `[term][channel]`.
    pub(super) fn terms(
        &self,
        model: ColorModel,
        sample_counts: &[u32],
    ) -> Result<Vec<usize>, Error> {
        // The picture repeats the last term; it is not read, but must be there.
        self.layer(model.channels(), "")?;
        let mut terms = Vec::new();
        for &count in sample_counts {
            terms.extend(self.layer(model.channels(), &term_name(count))?);
        }
        Ok(terms)
    }

    /// The side channels: layers beside the picture, the terms and the state. A layer that
    /// this version knows must have the right channels. One that it does not know, or that has
    /// the name of a feature but not its channels, becomes a side channel if it has the channels
    /// of the picture, as 32-bit floats, and is ignored otherwise.
    pub(super) fn sides(
        &self,
        model: ColorModel,
        sample_counts: &[u32],
    ) -> Result<BTreeMap<Side, Vec<usize>>, Error> {
        let terms: BTreeSet<String> = sample_counts.iter().copied().map(term_name).collect();
        let layers: BTreeSet<&str> = self
            .by_name
            .keys()
            .filter_map(|name| Some(name.rsplit_once('.')?.0))
            .filter(|layer| !terms.contains(*layer) && !layer.starts_with("state."))
            .collect();
        let mut sides = BTreeMap::new();
        for layer in layers {
            let Ok(side) = layer.parse::<Side>();
            match (self.layer(model.side_channels(&side), layer), &side) {
                (Ok(channels), _) => drop(sides.insert(side, channels)),
                (Err(_), Side::Other(_)) => {}
                // Other programs have layers of such names, too.
                (Err(_), side) if side.is_feature() => {
                    if let Ok(channels) = self.layer(model.channels(), layer) {
                        sides.insert(Side::Other(layer.into()), channels);
                    }
                }
                (Err(error), _) => return Err(error),
            }
        }
        Ok(sides)
    }
}
