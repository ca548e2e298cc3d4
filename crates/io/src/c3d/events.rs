//! The events of a C3D file, such as a foot's strike.

use super::C3d;

/// An event as the file has it.
#[derive(Debug, Clone, PartialEq)]
pub struct FileEvent {
    /// Whose it is: `Left`, `Right`, `General`.
    pub context: String,
    /// What it is: `Foot Strike`, `Foot Off`.
    pub label: String,
    /// Seconds; frame 1 is at 0.
    pub time: f64,
}

impl C3d {
    /// The events (EVENT:TIMES, CONTEXTS, LABELS) in time; those without a time are left out.
    pub fn events(&self) -> Vec<FileEvent> {
        let used = self.parameters.number("EVENT:USED").unwrap_or(0.0) as usize;
        let times = self.parameters.all_numbers("EVENT:TIMES");
        let mut contexts = self.parameters.all_texts("EVENT:CONTEXTS");
        let mut labels = self.parameters.all_texts("EVENT:LABELS");
        let text = |texts: &mut dyn Iterator<Item = &str>| {
            texts.next().unwrap_or_default().trim().to_string()
        };
        let mut events: Vec<FileEvent> = times
            .chunks_exact(2)
            .take(used)
            .map(|time| FileEvent {
                context: text(&mut contexts),
                label: text(&mut labels),
                time: 60.0 * time[0] + time[1],
            })
            .filter(|event| event.time.is_finite())
            .collect();
        events.sort_by(|a, b| a.time.total_cmp(&b.time));
        events
    }
}

#[cfg(test)]
mod tests {
    use super::super::analog::testdata::file;

    #[test]
    fn events_are_in_time_and_may_lack_texts() {
        let parameters: [(u8, &str, &[f32]); 2] = [
            (3, "USED", &[9.0]),
            (3, "TIMES", &[1.0, 2.5, 0.0, 3.5, f32::NAN, 1.0]),
        ];
        let texts = b"\x08\x03CONTEXTS\x0c\0\xff\x02\x05\x01Right\0";
        let events = file(&parameters, texts, &[]).events();
        let times: Vec<f64> = events.iter().map(|e| e.time).collect();
        assert_eq!(times, [3.5, 62.5]);
        assert_eq!((&*events[0].context, &*events[1].context), ("", "Right"));
    }
}
