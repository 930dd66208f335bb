//! The tokens of a page: where they come from, and their end. A hang-up reads the files of tokens and of the
//! certificate again.

use std::{future::pending, path::PathBuf, sync::Arc, time::Duration};

use trimaran::page::{Pages, Token, TokenList, Tokens};
use trimaran_transport::{Net, causes, sleep_until};

use super::{Failure, address::Address, args::AccessArgs, log::SAID, reload::HangUps, walking::date};

/// Between two looks for tokens whose time has come.
const LOOKS: Duration = Duration::from_secs(1);

/// Where the tokens of a page come from.
pub(super) enum TokenSource<'s> {
    Given(Token),
    File(TokenFile),
    /// A new one each time.
    New,
    /// The same each time the model is viewed.
    KeptFor(&'s Address),
}

/// A file of tokens.
#[derive(Debug, Clone)]
pub(super) enum TokenFile {
    /// With the token itself.
    One(PathBuf),
    /// With a hash for each person.
    List(PathBuf),
}

impl From<&AccessArgs> for TokenSource<'_> {
    fn from(args: &AccessArgs) -> Self {
        let AccessArgs { token, token_file, tokens, .. } = args.clone();
        match (token, token_file, tokens) {
            (Some(token), ..) => Self::Given(token),
            (_, Some(file), _) => Self::File(TokenFile::One(file)),
            (.., Some(file)) => Self::File(TokenFile::List(file)),
            (None, None, None) => Self::New,
        }
    }
}

impl TokenSource<'_> {
    pub(super) fn read(&self, net: &dyn Net) -> Result<Tokens, Failure> {
        match self {
            Self::Given(token) => Ok(Tokens::One(token.clone())),
            Self::File(file) => file.read(),
            Self::New => Token::random(net).map(Tokens::One).map_err(Failure::broken),
            Self::KeptFor(address) => address.token(net).map(Tokens::One).map_err(Failure::broken),
        }
    }

    /// The file to read again.
    pub(super) fn file(&self) -> Option<&TokenFile> {
        match self {
            Self::File(file) => Some(file),
            _ => None,
        }
    }
}

impl TokenFile {
    fn read(&self) -> Result<Tokens, Failure> {
        match self {
            Self::One(file) => Token::from_file(file).map(Tokens::One).map_err(Failure::bad_input),
            Self::List(file) => TokenList::read(file).map(Tokens::Listed).map_err(Failure::bad_input),
        }
    }
}

/// Ends tokens in their time, and reads the files again at each hang-up. Never returns.
pub(super) async fn keep(
    pages: Pages,
    file: Option<TokenFile>,
    mut hang_ups: Option<HangUps>,
    net: Arc<dyn Net>,
) {
    loop {
        pages.expire_tokens(date());
        let hung_up = async {
            match &mut hang_ups {
                Some(hang_ups) => hang_ups.next().await,
                None => pending().await,
            }
        };
        tokio::select! {
            () = hung_up => renew(&pages, file.as_ref()),
            () = sleep_until(&*net, net.now().after(LOOKS)) => {}
        }
    }
}

fn renew(pages: &Pages, file: Option<&TokenFile>) {
    match file.map(TokenFile::read).transpose() {
        Ok(tokens) => tokens.iter().for_each(|tokens| pages.replace_tokens(tokens)),
        Err(failure) => tracing::error!(target: SAID, "the tokens stay as they were: {failure}"),
    }
    match pages.renew_certificate() {
        Ok(()) => tracing::info!("has read its tokens and its certificate again"),
        Err(error) => {
            tracing::error!(target: SAID, "the certificate stays as it was: {}", causes(&error));
        }
    }
}
