//! `isotherm read --browse`: lists nodes of an OPC UA server.

use crate::cli::print::print_json;
use crate::cli::print::{say, say_beside};
use crate::cli::runtime;
use crate::cli::target::Target;
use crate::cli::values::wrong_arguments;
use crate::discovery::opcua::{Described, browse, in_a_line};
use isotherm_core::codec::{Namespace, NodeId};
use isotherm_profile::{Bus, one_line};

/// Identifier of the standard folder `Objects`, which contains the server's own nodes.
const OBJECTS: &str = "i=85";

/// Options that select the nodes to show.
#[derive(clap::Args, Debug)]
#[command(next_help_heading = "The nodes of an OPC UA server")]
pub(in crate::cli) struct Nodes {
    /// Shows the nodes below this one, for example `ns=2;s=/Nck`, with type, access rights and value; without a node,
    /// those below the folder Objects
    #[arg(long, value_name = "NODE", num_args = 0..=1, default_missing_value = OBJECTS, conflicts_with_all = ["register", "watch"])]
    browse: Option<NodeId>,
    /// Number of levels below the first node to show
    #[arg(long, value_name = "LEVELS", default_value_t = 2, value_parser = clap::value_parser!(u8).range(0..=20), requires = "browse")]
    depth: u8,
    /// Largest number of nodes to show
    #[arg(long, value_name = "N", default_value_t = 200, value_parser = clap::value_parser!(u16).range(1..=10_000), requires = "browse")]
    most: u16,
}

impl Nodes {
    pub(in crate::cli) fn is_asked_for(&self) -> bool {
        self.browse.is_some()
    }
}

pub(super) fn run(target: &Target, nodes: &Nodes, json: bool) -> anyhow::Result<()> {
    let Some(first) = &nodes.browse else { return Ok(()) };
    let Some(bus) = server(target, json)? else {
        return Err(wrong_arguments(
            "--browse needs an OPC UA server: --bus opc.tcp://HOST, or a PROFILE with --bus NAME",
        ));
    };
    let browsing = browse(&bus, first, usize::from(nodes.depth), usize::from(nodes.most));
    let tree = runtime::start()?.block_on(browsing).map_err(anyhow::Error::msg)?;
    if json {
        return print_json(&tree);
    }
    tree.nodes.iter().try_for_each(|node| say!("{}", line(node)))?;
    for (index, uri) in &tree.namespaces {
        let named = Namespace::Uri(uri.clone()).to_string();
        say_beside!(
            "ns={index} is {} on this server. Write this name instead of ns={index}, because the server may \
             change the index",
            one_line(&named)
        );
    }
    if tree.is_cut {
        say_beside!(
            "there are more nodes: --most N shows more than {}, --browse NODE begins at one of the nodes \
             above",
            tree.nodes.len()
        );
    }
    Ok(())
}

/// Returns the OPC UA server that the arguments name; `None` if they name none.
fn server(target: &Target, json: bool) -> anyhow::Result<Option<Bus>> {
    if target.bus.is_none() && target.profile.is_none() {
        return Ok(None);
    }
    let bus = target.any(json)?.bus;
    Ok(Some(bus).filter(|bus| bus.opcua.is_some()))
}

fn line(found: &Described) -> String {
    let indent = "  ".repeat(found.depth);
    let (said, node) = (in_a_line(found), one_line(&found.node));
    format!("{indent}{node}  {}  {said}", found.name).trim_end().to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;
    use isotherm_core::reading::Status;

    #[test]
    fn a_node_is_one_line_whatever_its_name_holds() {
        let (node, name) = ("ns=2;s=a\n  ns=2;s=offset\t\u{1b}[2J".to_owned(), "a".to_owned());
        let found = Described { node, depth: 1, name, variable: None, status: Status(0) };
        assert_eq!(line(&found), "  ns=2;s=a\\n  ns=2;s=offset\\t\\u001b[2J  a");
    }
}
