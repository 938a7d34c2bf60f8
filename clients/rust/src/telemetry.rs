//! Every cycle of every axis, as arrays.

use std::sync::Arc;

use crate::error::{Error, Problem, Result};
use crate::messages::{Bytes, Info, TelemetryBlock};
use crate::wire::decode;

/// Some cycles of every axis, in mm, deg and s.
///
/// Arrays are of shape (rows, axes) in C order: the value of the `k`th axis in row `i` is at `i * axes.len() + k`.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Samples {
    /// Number of the first row's cycle; a jump means cycles lost on the way.
    pub seq: u64,
    /// Executor time of the first row [s].
    pub t: f64,
    /// Time between two rows [s].
    pub cycle_s: f64,
    /// How many cycles.
    pub rows: usize,
    /// The axes' numbers.
    pub axes: Arc<[u64]>,
    fields: Vec<(String, Vec<f32>)>,
}

impl Samples {
    /// Executor time of a row [s].
    #[must_use]
    #[allow(clippy::cast_precision_loss, reason = "a message has some ten rows")]
    pub fn time_s(&self, row: usize) -> f64 {
        self.t + self.cycle_s * row as f64
    }

    /// Setpoints [mm, deg].
    #[must_use]
    pub fn setpoint(&self) -> &[f32] {
        self.field("setpoint")
    }

    /// The encoders' readings [mm, deg].
    #[must_use]
    pub fn position(&self) -> &[f32] {
        self.field("position")
    }

    /// Velocities [mm/s, deg/s].
    #[must_use]
    pub fn velocity(&self) -> &[f32] {
        self.field("velocity")
    }

    /// Torques [N·m].
    #[must_use]
    pub fn torque(&self) -> &[f32] {
        self.field("torque")
    }

    /// A field by its name in `info.telemetry.fields`; empty where the server sends no such field.
    #[must_use]
    pub fn field(&self, name: &str) -> &[f32] {
        self.fields.iter().find(|(each, _)| each == name).map_or(&[], |(_, values)| values)
    }
}

/// Reads a message of `tele/batch` as `info` says; MC533: it is no such message.
pub(crate) fn decode_samples(payload: &[u8], info: &Info) -> Result<Samples> {
    let TelemetryBlock {
        seq,
        t,
        rows: Bytes(bytes),
    } = decode(payload)?;
    let names = &info.telemetry.fields;
    let columns = info.telemetry.axes.len() * names.len();
    if columns == 0 || bytes.len() % (4 * columns) != 0 {
        return Err(Error::Protocol(Box::new(Problem::new(
            "MC533",
            format!("{} bytes of samples do not fit {columns} columns", bytes.len()),
            "has the machine's configuration changed?",
        ))));
    }
    let values: Vec<f32> =
        bytes.chunks_exact(4).map(|four| f32::from_le_bytes([four[0], four[1], four[2], four[3]])).collect();
    let fields = names.iter().enumerate().map(|(index, name)| {
        let column = values.iter().skip(index).step_by(names.len()).copied();
        (name.clone(), column.collect())
    });
    Ok(Samples {
        seq,
        t,
        cycle_s: info.cycle_s,
        rows: values.len() / columns,
        axes: info.telemetry.axes.as_slice().into(),
        fields: fields.collect(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn info() -> Info {
        let written = serde_json::json!({"machine": "m", "server": "1", "protocol": [1], "instance": "i", "epoch": 0.0,
            "cycle_s": 0.001, "axes": [], "tools": [], "methods": [],
            "telemetry": {"axes": [3, 7], "fields": ["setpoint", "torque"], "cycles_a_message": 10, "state_hz": 20.0},
            "limits": {"max_line_length": 100, "max_lines_a_message": 100, "queue_lines": 100, "programs_at_once": 8,
            "open_programs": 64, "remembered_answers": 64, "remembered_answer_s": 60.0}});
        serde_json::from_value(written).unwrap()
    }

    /// `[5, 1.25, bin]` with these floats.
    fn block(values: &[f32]) -> Vec<u8> {
        let mut payload = vec![0x93, 5, 0xcb];
        payload.extend(1.25_f64.to_be_bytes());
        payload.extend([0xc4, u8::try_from(4 * values.len()).unwrap()]);
        payload.extend(values.iter().flat_map(|value| value.to_le_bytes()));
        payload
    }

    #[test]
    fn fields_are_taken_apart_into_arrays_of_rows_and_axes() {
        let payload = block(&[1.0, -1.0, 2.0, -2.0, 3.0, -3.0, 4.0, -4.0]);
        let samples = decode_samples(&payload, &info()).unwrap();
        assert_eq!((samples.seq, samples.rows, &*samples.axes), (5, 2, &[3, 7][..]));
        assert_eq!(samples.setpoint(), [1.0, 2.0, 3.0, 4.0]);
        assert_eq!(samples.torque(), [-1.0, -2.0, -3.0, -4.0]);
        assert!(samples.velocity().is_empty());
        assert!((samples.time_s(1) - 1.251).abs() < 1e-12);
    }

    #[test]
    fn rows_that_do_not_fit_the_axes_are_refused() {
        for payload in [block(&[1.0, 2.0, 3.0]), vec![0x90], vec![0x93, 5, 1, 0xa1, b'x']] {
            assert_eq!(decode_samples(&payload, &info()).unwrap_err().code(), "MC533");
        }
        let mut none = info();
        none.telemetry.axes.clear();
        assert_eq!(decode_samples(&block(&[]), &none).unwrap_err().code(), "MC533");
    }
}
