use super::*;
use crate::compensation::Snapshot;
use crate::compensation::model::{Kind, Model, Reference};
use crate::compensation::reference::Machine;
use crate::quantity::Moment;
use crate::quantity::of;
use crate::reading::Reading;

#[cfg(feature = "onnx")]
mod onnx;

fn close(found: f64, expected: f64) {
    assert!((found - expected).abs() < 1e-6, "{found} is not {expected}");
}

fn weights() -> [(Vec<Vec<f64>>, Vec<f64>); 2] {
    let hidden = vec![vec![0.5, -0.25], vec![1.0, 0.75], vec![-0.5, 0.125]];
    [(hidden, vec![0.1, -0.2, 0.3]), (vec![vec![2.0, -3.0, 1.5]], vec![0.25])]
}

/// Computes the network of [`weights`] by explicit formulas, for inputs that are already scaled.
fn by_hand(a: f64, b: f64, f: impl Fn(f64) -> f64) -> f64 {
    let h = [f(0.5 * a - 0.25 * b + 0.1), f(a + 0.75 * b - 0.2), f(-0.5 * a + 0.125 * b + 0.3)];
    2.0 * h[0] - 3.0 * h[1] + 1.5 * h[2] + 0.25
}

fn layers(activation: Activation) -> Net {
    let [hidden, last] = weights();
    let layer = |(weights, bias), activation| Layer { weights, bias, activation };
    let scaling = Scaling::new(&[20.0, 100.0], &[4.0, 50.0]).unwrap();
    let layers = vec![layer(hidden, activation), layer(last, Activation::Linear)];
    Net::Layers(Layers::new(scaling, layers, (5.0, 10.0)).unwrap())
}

#[test]
fn m10_a_back_propagation_network_is_its_layers_by_hand() {
    let (a, b) = ((26.0 - 20.0) / 4.0, (80.0 - 100.0) / 50.0);
    let relu = |sum: f64| sum.max(0.0);
    close(layers(Activation::Tanh).output(&[26.0, 80.0]), 5.0 + 10.0 * by_hand(a, b, f64::tanh));
    close(layers(Activation::Relu).output(&[26.0, 80.0]), 5.0 + 10.0 * by_hand(a, b, relu));
    assert_eq!(layers(Activation::Tanh).what(), "back-propagation network 2-3-1");
}

#[test]
fn m10_a_radial_basis_network_is_its_nodes_by_hand() {
    let scaling = Scaling::new(&[20.0, 0.0], &[2.0, 1.0]).unwrap();
    let node = |centre: [f64; 2], width, weight| Node { centre: centre.to_vec(), width, weight };
    let nodes = vec![node([1.0, 0.0], 1.0, 3.0), node([-1.0, 2.0], 2.0, -4.0)];
    let net = Net::Radial(Radial::new(scaling, nodes, 0.5, (1.0, 2.0)).unwrap());
    // x = (2, 1): squared distances 1 + 1 and 9 + 1.
    let expected = 1.0 + 2.0 * (0.5 + 3.0 * (-1.0_f64).exp() - 4.0 * (-10.0_f64 / 8.0).exp());
    close(net.output(&[24.0, 1.0]), expected);
    close(net.output(&[1e300, 1.0]), 1.0 + 2.0 * 0.5);
}

#[test]
fn shapes_that_do_not_fit_each_other_are_refused() {
    let scaling = || Scaling::new(&[0.0, 0.0], &[1.0, 1.0]).unwrap();
    let layer =
        |weights: Vec<Vec<f64>>, bias: Vec<f64>| Layer { weights, bias, activation: Activation::Tanh };
    let layers = |layers: Vec<Layer>| Layers::new(scaling(), layers, (0.0, 1.0)).unwrap_err();
    for (why, words) in [
        (Scaling::new(&[0.0], &[1.0, 1.0]).unwrap_err(), "1 means and 2 scales"),
        (Scaling::new(&[0.0], &[0.0]).unwrap_err(), "the scale not zero"),
        (layers(vec![]), "the last layer has 2 neurons"),
        (layers(vec![layer(vec![vec![1.0]], vec![0.0])]), "layer 1, neuron 1: 1 weights"),
        (layers(vec![layer(vec![vec![1.0, 1.0]], vec![])]), "1 rows of weights and 0 biases"),
        (layers(vec![layer(vec![vec![1.0, f64::NAN]], vec![0.0])]), "finite"),
    ] {
        assert!(why.contains(words), "{why}");
    }
    let node = |centre: &[f64], width| Node { centre: centre.to_vec(), width, weight: 1.0 };
    let radial = |nodes| Radial::new(scaling(), nodes, 0.0, (0.0, 1.0)).unwrap_err();
    assert!(radial(vec![]).contains("no nodes"));
    assert!(radial(vec![node(&[0.0], 1.0)]).contains("centre 1 has 1 numbers, but there are 2 inputs"));
    assert!(radial(vec![node(&[0.0, 0.0], 0.0)]).contains("width 1 is 0"));
    let input = Input::of(SignalId(0), Reference::Fixed(of(0.0)), None);
    let why = Network::new("n.json", super::tests::layers(Activation::Tanh), vec![input]).unwrap_err();
    assert_eq!(why, "the network has 2 inputs, but the model names 1");
}

#[test]
fn inputs_are_rises_and_a_result_that_is_no_number_is_none() {
    let input = |place, reference| Input::of(SignalId(place), reference, None);
    let inputs = vec![input(0, Reference::Fixed(of(1.5))), input(1, Reference::Fixed(of(0.0)))];
    let model = |net| {
        Model::new("net".to_owned(), Kind::Network(Network::new("n.json", net, inputs.clone()).unwrap()))
    };
    let now = Moment::from_nanos(0);
    let ask = |model: &Model, a, b| {
        let readings = [Reading::good(a, now), Reading::good(b, now)];
        let (snapshot, machine) = (Snapshot::new(now, &readings), Machine::default());
        let known = Inputs { snapshot, machine: &machine, lags: &[], splits_slope: false };
        model.evaluate(&known).map(|evaluated| evaluated.outputs.cz.get())
    };
    let tanh = layers(Activation::Tanh);
    close(ask(&model(tanh.clone()), 27.5, 80.0).unwrap(), tanh.output(&[26.0, 80.0]));
    let relu = model(layers(Activation::Relu));
    assert_eq!(ask(&relu, f64::MAX, -f64::MAX), Err(Unusable::NotANumber));
}
