//! Object stores: Amazon S3 and what speaks like it, Google Cloud Storage, Azure Blob Storage.

use std::ops::Range;
use std::sync::Arc;

use futures_util::StreamExt;
use object_store::aws::AmazonS3Builder;
use object_store::azure::MicrosoftAzureBuilder;
use object_store::gcp::GoogleCloudStorageBuilder;
use object_store::path::Path;
use object_store::{ClientConfigKey, Error, GetOptions, ObjectStore, ObjectStoreScheme, RetryConfig};
use url::Url;

use crate::answer::{Answer, Piece};
use crate::error::{Failed, chain};
use crate::{RemoteError, RemoteOptions};

pub(crate) struct Store {
    store: Arc<dyn ObjectStore>,
    path: Path,
}

impl Store {
    /// Opens the store of an address. Keys, region and endpoint are those of the environment (`AWS_...`, `GOOGLE_...`, `AZURE_...`).
    pub(crate) fn new(address: &Url, options: &RemoteOptions) -> Result<Self, RemoteError> {
        let _ = rustls::crypto::ring::default_provider().install_default();
        let (scheme, path) = ObjectStoreScheme::parse(address).map_err(|error| RemoteError::Address(chain(&error)))?;
        // Requests are repeated by the caller.
        let retry = RetryConfig { max_retries: 0, retry_timeout: options.patience, ..RetryConfig::default() };
        let url = address.as_str();
        let seconds = format!("{} seconds", options.patience.as_secs().max(1));
        macro_rules! store {
            ($builder:ty, $key:path) => {
                <$builder>::from_env()
                    .with_url(url)
                    .with_retry(retry)
                    .with_config($key(ClientConfigKey::ConnectTimeout), &seconds)
                    .with_config($key(ClientConfigKey::Timeout), "1 day")
                    .build()
                    .map(|store| Arc::new(store) as Arc<dyn ObjectStore>)
            };
        }
        let store = match scheme {
            ObjectStoreScheme::AmazonS3 => store!(AmazonS3Builder, object_store::aws::AmazonS3ConfigKey::Client),
            ObjectStoreScheme::GoogleCloudStorage => {
                store!(GoogleCloudStorageBuilder, object_store::gcp::GoogleConfigKey::Client)
            }
            ObjectStoreScheme::MicrosoftAzure => {
                store!(MicrosoftAzureBuilder, object_store::azure::AzureConfigKey::Client)
            }
            other => return Err(RemoteError::Address(format!("is of a store that is not known here ({other:?})"))),
        };
        let store = store.map_err(|error| {
            RemoteError::Address(format!(
                "{}; keys, region and endpoint are set by AWS_..., GOOGLE_... or AZURE_... in the environment",
                chain(&error)
            ))
        })?;
        Ok(Self { store, path })
    }

    /// Asks for a range, if the object still has the tag.
    pub(crate) async fn get(
        &self,
        range: &Range<u64>,
        tag: Option<&str>,
        options: &RemoteOptions,
    ) -> Result<Answer, Failed> {
        let request =
            GetOptions { range: Some(range.clone().into()), if_match: tag.map(str::to_owned), ..GetOptions::default() };
        let answer = tokio::time::timeout(options.patience, self.store.get_opts(&self.path, request)).await;
        let got = match answer {
            Err(_) => {
                return Err(Failed::again(format!(
                    "the store did not answer for {} s",
                    options.patience.as_secs_f32()
                )));
            }
            Ok(Err(error)) => return Err(failed(&error)),
            Ok(Ok(got)) => got,
        };
        let (length, tag) = (got.meta.size, got.meta.e_tag.clone());
        if got.range != (range.start..range.end.min(length)) {
            let (Range { start, end }, wanted) = (&got.range, range);
            return Err(Failed::answer(format!(
                "bytes {start}..{end} were sent, {}..{} were asked for",
                wanted.start, wanted.end
            )));
        }
        let body = got.into_stream().map(|piece| match piece {
            Ok(piece) => Ok(Box::new(piece) as Piece),
            Err(error) => Err(chain(&error)),
        });
        Ok(Answer::Range { length, tag, body: Box::pin(body) })
    }
}

fn failed(error: &Error) -> Failed {
    let what = chain(error);
    match error {
        Error::NotFound { .. } => RemoteError::Refused("the store has no such object; check bucket and name".into()).into(),
        Error::Precondition { .. } => RemoteError::Replaced("its entity tag has changed".into()).into(),
        Error::PermissionDenied { .. } | Error::Unauthenticated { .. } => RemoteError::Refused(
            "the store does not let these keys read it; set AWS_..., GOOGLE_... or AZURE_... in the environment, or AWS_SKIP_SIGNATURE=true for a public bucket".into(),
        )
        .into(),
        // What answers but does not do what was asked for.
        Error::NotSupported { .. } => Failed::answer(what),
        _ => Failed::again(what),
    }
}
