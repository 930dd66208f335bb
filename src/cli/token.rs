//! `trimaran token`: tokens by which people open a page.

use std::io::Write as _;

use trimaran::page::{May, PersonName, Token, TokenEntry, TokenHash, Until};
use trimaran_transport::TokioNet;

use super::{Failure, args::TokenCommand, printed, terminal::stdout, walking::runtime};

pub(super) fn run(command: &TokenCommand) -> Result<(), Failure> {
    match command {
        TokenCommand::New { name, until, look } => {
            new(name, until.as_ref(), if *look { May::Look } else { May::Write })
        }
    }
}

fn new(name: &PersonName, until: Option<&Until>, may: May) -> Result<(), Failure> {
    let net = TokioNet::new(runtime()?.handle().clone());
    let token = Token::random(&net).map_err(Failure::broken)?;
    let sha256 = TokenHash::of(token.as_str());
    let entry = TokenEntry { name: name.clone(), sha256, until: until.cloned(), may };
    printed(writeln!(stdout(), "{entry}\n"))?;
    eprintln!("the token of {}, which is kept nowhere: {}", name.as_str(), token.as_str());
    Ok(())
}
