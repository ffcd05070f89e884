//! A linear model as its profile writes it, with lags and a slope: `Cz = offset + Σ gain·y + (p − p0)·Σ gain·y`, where y
//! is the rise since machine start, behind a first-order lag that is exact for an input that moves linearly.

/// The first model of an axis.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Line {
    pub(super) offset: f64,
    pub(super) terms: Vec<Term>,
    pub(super) slope: Option<Slope>,
}

#[derive(Clone, Debug, PartialEq)]
pub(super) struct Slope {
    pub(super) position: String,
    pub(super) reference: f64,
    pub(super) terms: Vec<Term>,
}

#[derive(Clone, Debug, PartialEq)]
pub(super) struct Term {
    pub(super) signal: String,
    pub(super) gain: f64,
    /// Seconds; zero: none.
    pub(super) lag: f64,
}

/// One first-order lag that begins at rest.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Lag {
    state: f64,
    input: f64,
}

impl Lag {
    pub(super) fn advance(&mut self, input: f64, seconds: f64, constant: f64) -> f64 {
        if constant > 0.0 {
            let a = (-seconds / constant).exp();
            let ramp = 1.0 - (1.0 - a) * constant / seconds;
            self.state = a * self.state + (1.0 - a) * self.input + ramp * (input - self.input);
        } else {
            self.state = input;
        }
        self.input = input;
        self.state
    }
}

impl Line {
    pub(super) fn read(model: &toml::Table) -> Line {
        let terms = |table: &toml::Table| {
            let terms = table.get("terms").and_then(toml::Value::as_array);
            terms.into_iter().flatten().map(|term| Term::read(term.as_table().unwrap())).collect()
        };
        let slope = model.get("slope").and_then(toml::Value::as_table).map(|slope| Slope {
            position: slope["position"].as_str().unwrap().to_owned(),
            reference: slope["reference"].as_float().unwrap(),
            terms: terms(slope),
        });
        Line { offset: model["offset"].as_float().unwrap(), terms: terms(model), slope }
    }

    /// All its terms, those of the slope last.
    pub(super) fn all(&self) -> impl Iterator<Item = &Term> {
        self.terms.iter().chain(self.slope.iter().flat_map(|slope| &slope.terms))
    }
}

impl Term {
    fn read(term: &toml::Table) -> Term {
        assert_eq!(term["reference"].as_str(), Some("start"));
        let lag = term.get("lag").and_then(toml::Value::as_str).map(humantime::parse_duration);
        Term {
            signal: term["signal"].as_str().unwrap().to_owned(),
            gain: term["gain"].as_float().unwrap(),
            lag: lag.map_or(0.0, |lag| lag.unwrap().as_secs_f64()),
        }
    }
}

/// M4 of the reference values: a step of 5 °C, and a ramp, at 600, 1800 and 3600 s.
#[test]
fn the_lag_is_exact_for_steps_and_ramps() {
    let gain = 3.45;
    let (mut step, mut ramp) = (Lag { state: 0.0, input: 5.0 }, Lag::default());
    for second in 1..=3600u32 {
        let (after_step, after_ramp) =
            (step.advance(5.0, 1.0, 1800.0), ramp.advance(0.001 * f64::from(second), 1.0, 1800.0));
        let expected = match second {
            600 => (4.889835, 0.309659),
            1800 => (10.904080, 2.284531),
            3600 => (14.915466, 7.050432),
            _ => continue,
        };
        assert!((gain * after_step - expected.0).abs() < 1e-6, "{second} s: {}", gain * after_step);
        assert!((gain * after_ramp - expected.1).abs() < 1e-6, "{second} s: {}", gain * after_ramp);
    }
}
