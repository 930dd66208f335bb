//! The people who may see a page, and how they reach it.

use std::path::PathBuf;

use clap::{Args, Subcommand};
use hyper::header::HeaderName;
use trimaran::page::{FrameAncestor, PersonName, Proxies, ProxyNetwork, TlsFiles, Token, Until};

/// The tokens of a page, its certificate, and the proxies in front of it.
#[derive(Debug, Clone, Args)]
pub(crate) struct AccessArgs {
    /// The secret in the page's address, 16 to 128 letters and digits [default: a new one each time].
    #[arg(long, value_name = "TOKEN", env = "TRIMARAN_TOKEN", hide_env_values = true)]
    pub(crate) token: Option<Token>,
    /// A file with that secret, such as a credential of systemd. Read again on SIGHUP.
    #[arg(long, value_name = "FILE", env = "TRIMARAN_TOKEN_FILE", conflicts_with = "token")]
    pub(crate) token_file: Option<PathBuf>,
    /// A file (TOML) with a token for each person, in place of one for all: `trimaran token new NAME` prints
    /// an entry. Read again on SIGHUP; links of tokens that were removed or have expired end.
    #[arg(
        long,
        value_name = "F.toml",
        env = "TRIMARAN_TOKENS",
        conflicts_with_all = ["token", "token_file"]
    )]
    pub(crate) tokens: Option<PathBuf>,
    /// Encrypt by TLS 1.3 with this certificate (PEM), and behind it those that lead to its authority. Pages
    /// are then at https://, links of displays at wss://. Read again on SIGHUP.
    #[arg(long, value_name = "FILE", env = "TRIMARAN_TLS_CERT", requires = "tls_key")]
    tls_cert: Option<PathBuf>,
    /// The private key of the certificate (PEM). Read again on SIGHUP.
    #[arg(long, value_name = "FILE", env = "TRIMARAN_TLS_KEY", requires = "tls_cert")]
    tls_key: Option<PathBuf>,
    /// The addresses or networks of proxies in front, such as 127.0.0.1 or 10.0.0.0/8. From them alone
    /// X-Forwarded-For, X-Forwarded-Host and X-Forwarded-Proto count.
    #[arg(long, value_name = "ADDRESS,..", value_delimiter = ',', env = "TRIMARAN_TRUSTED_PROXIES")]
    trusted_proxies: Vec<ProxyNetwork>,
    /// The header in which these proxies name the person whom they have let in, such as X-Forwarded-User. It
    /// gives a name for the log and for other people, and opens nothing.
    #[arg(long, value_name = "HEADER", env = "TRIMARAN_PROXY_HEADER", requires = "trusted_proxies")]
    proxy_header: Option<HeaderName>,
}

impl AccessArgs {
    /// The files of the certificate.
    pub(crate) fn tls(&self) -> Option<TlsFiles> {
        let (certificate, key) = (self.tls_cert.clone()?, self.tls_key.clone()?);
        Some(TlsFiles { certificate, key })
    }

    /// The proxies.
    pub(crate) fn proxies(&self) -> Proxies {
        Proxies { trusted: self.trusted_proxies.clone(), name_header: self.proxy_header.clone() }
    }
}

/// The pages around a page.
#[derive(Debug, Clone, Args)]
pub(crate) struct EmbeddingArgs {
    /// The origins of pages that may show this one in a frame and drive it by messages, such as
    /// https://portal.example [default: none but its own].
    #[arg(long, value_name = "ORIGIN,..", value_delimiter = ',', env = "TRIMARAN_FRAME_ANCESTORS")]
    pub(crate) frame_ancestors: Vec<FrameAncestor>,
}

#[derive(Debug, Subcommand)]
pub(crate) enum TokenCommand {
    /// Make a token: prints an entry for a file of tokens, and on standard error the token itself, which is
    /// kept nowhere.
    New {
        /// The person's name, for the log and for other people.
        name: PersonName,
        /// When it ends: with a day, such as 2030-12-31, or at a time, such as 2030-12-31T18:00:00Z. Both
        /// are UTC [default: never].
        #[arg(long, value_name = "DATE")]
        until: Option<Until>,
        /// Let its holder look, and write no notes.
        #[arg(long)]
        look: bool,
    },
}
