//! What an address names: a store, and a path in it. Stores get their credentials from the standard
//! variables of the environment, and read without any where there are none.

use crate::connection::Connector;
use crate::fetch::deepest;
use crate::threads::choose_tls;
use object_store::aws::AmazonS3Builder;
use object_store::azure::MicrosoftAzureBuilder;
use object_store::gcp::GoogleCloudStorageBuilder;
use object_store::http::HttpBuilder;
use object_store::multipart::MultipartStore;
use object_store::path::Path;
use object_store::{ClientOptions, ObjectStore, RetryConfig};
use std::env::{var, var_os};
use std::io;
use std::sync::Arc;
use std::time::Duration;
use url::Url;

/// A store that is read, and a path in it.
pub type Located = (Arc<dyn ObjectStore>, Path);

/// A store of objects that can also be written in parts.
pub trait Bucket: ObjectStore + MultipartStore {}

impl<T: ObjectStore + MultipartStore> Bucket for T {}

/// A bucket, and a path in it.
pub type InBucket = (Arc<dyn Bucket>, Path);

/// Longest time for a connection.
const CONNECT: Duration = Duration::from_secs(10);

/// Variables that give credentials to the stores.
const AWS: [&str; 3] =
    ["AWS_ACCESS_KEY_ID", "AWS_WEB_IDENTITY_TOKEN_FILE", "AWS_CONTAINER_CREDENTIALS_RELATIVE_URI"];
const AZURE: [&str; 6] = [
    "AZURE_STORAGE_ACCOUNT_KEY",
    "AZURE_STORAGE_ACCESS_KEY",
    "AZURE_STORAGE_SAS_TOKEN",
    "AZURE_STORAGE_SAS_KEY",
    "AZURE_STORAGE_CLIENT_SECRET",
    "AZURE_FEDERATED_TOKEN_FILE",
];
const GOOGLE: [&str; 5] = [
    "GOOGLE_SERVICE_ACCOUNT",
    "GOOGLE_SERVICE_ACCOUNT_PATH",
    "GOOGLE_SERVICE_ACCOUNT_KEY",
    "SERVICE_ACCOUNT",
    "GOOGLE_APPLICATION_CREDENTIALS",
];

/// Finds what an address names; nothing is read. `answer` is the longest time without a byte.
///
/// # Errors
/// If it is no address, has a password, or a query for a store, or its store is not known or not
/// configured.
pub fn locate(address: &str, answer: Duration) -> io::Result<Located> {
    let (url, path) = parsed(address)?;
    // A long answer over a slow line is no fault: what counts is that bytes keep coming.
    let options = options(answer).with_read_timeout(answer);
    if !matches!(url.scheme(), "http" | "https") {
        return Ok((bucket(&url, address, options)?, path));
    }
    let options = options.with_allow_http(url.scheme() == "http");
    // The store puts the path before the query.
    let mut origin = url;
    origin.set_path("");
    let http = HttpBuilder::new().with_url(origin).with_client_options(options);
    let http = http.with_http_connector(Connector).with_retry(no_retry()).build();
    Ok((Arc::new(http.map_err(|e| unreachable_store(&e))?), path))
}

/// Finds the bucket that an address names, to write to it; nothing is written. While a request is
/// sent no byte comes, so that those who make it limit its time; `connect` limits that of a
/// connection.
///
/// # Errors
/// As for [`locate`]; if objects cannot be written there.
pub fn locate_bucket(address: &str, connect: Duration) -> io::Result<InBucket> {
    let (url, path) = parsed(address)?;
    if matches!(url.scheme(), "http" | "https") {
        let what = "servers of files are only read: name a place in object storage (s3, gs or az) \
                    or a folder";
        return Err(io::Error::new(io::ErrorKind::Unsupported, what));
    }
    Ok((bucket(&url, address, options(connect))?, path))
}

fn invalid(what: String) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidInput, what)
}

fn unreachable_store(error: &object_store::Error) -> io::Error {
    invalid(format!("cannot be reached: {}", deepest(error)))
}

/// An address, checked, and the path in its store.
fn parsed(address: &str) -> io::Result<(Url, Path)> {
    let url = Url::parse(address).map_err(|e| invalid(format!("is no valid address: {e}")))?;
    if !url.username().is_empty() || url.password().is_some() {
        return Err(invalid(
            "has a user or a password in it, which messages would show; give credentials by the \
             variables of the environment"
                .into(),
        ));
    }
    let is_http = matches!(url.scheme(), "http" | "https");
    if (url.query().is_some() && !is_http) || url.fragment().is_some() {
        return Err(invalid("has a `?` or a `#`, which have no meaning there".into()));
    }
    if url.path().to_ascii_lowercase().contains("%2f") {
        return Err(invalid("has an encoded `/`, which is not supported in addresses".into()));
    }
    choose_tls();
    let path = Path::from_url_path(url.path()).map_err(|e| invalid(e.to_string()))?;
    Ok((url, path))
}

fn options(connect: Duration) -> ClientOptions {
    ClientOptions::new().with_timeout_disabled().with_connect_timeout(CONNECT.min(connect))
}

/// Requests are repeated by those who make them.
fn no_retry() -> RetryConfig {
    RetryConfig { max_retries: 0, ..RetryConfig::default() }
}

fn bucket(url: &Url, address: &str, options: ClientOptions) -> io::Result<Arc<dyn Bucket>> {
    let has = |names: &[&str]| names.iter().any(|name| var_os(name).is_some());
    let store: Result<Arc<dyn Bucket>, _> = match url.scheme() {
        "s3" | "s3a" => {
            let s3 = AmazonS3Builder::from_env().with_url(address);
            let is_allowed = var("AWS_ALLOW_HTTP").is_ok_and(|word| is_yes(&word));
            let options = options.with_allow_http(is_allowed);
            let s3 = s3.with_client_options(options).with_retry(no_retry());
            // Not all that is like S3 removes many objects at once.
            let s3 = s3.with_http_connector(Connector).with_disable_bulk_delete(true);
            s3.with_skip_signature(!has(&AWS)).build().map(|s| Arc::new(s) as _)
        }
        "gs" => {
            let gcs = GoogleCloudStorageBuilder::from_env().with_url(address);
            let gcs = gcs.with_client_options(options).with_retry(no_retry());
            let gcs = gcs.with_http_connector(Connector);
            gcs.with_skip_signature(!has(&GOOGLE)).build().map(|s| Arc::new(s) as _)
        }
        "az" | "azure" | "abfs" | "abfss" => {
            let azure = MicrosoftAzureBuilder::from_env().with_url(address);
            let azure = azure.with_client_options(options).with_retry(no_retry());
            let azure = azure.with_http_connector(Connector);
            azure.with_skip_signature(!has(&AZURE)).build().map(|s| Arc::new(s) as _)
        }
        other => {
            return Err(invalid(format!(
                "`{other}://` is not read; http, https, s3, gs and az are"
            )));
        }
    };
    store.map_err(|e| unreachable_store(&e))
}

/// Whether the value of a variable switches something on.
fn is_yes(word: &str) -> bool {
    matches!(word.to_ascii_lowercase().as_str(), "1" | "true" | "on" | "yes" | "y")
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests may panic")]
mod tests {
    use super::*;

    #[test]
    fn addresses_that_would_show_secrets_and_unknown_ones_are_refused_without_them() {
        for address in [
            "https://user:secret@host/a.esker",
            "s3://bucket/a.esker?sig=secret",
            "https://host/a%2Fb.esker?sig=secret",
            "https://host/a.esker#secret",
            "ftp://host/a.esker",
            "https://",
        ] {
            let error = locate(address, Duration::from_secs(1)).unwrap_err().to_string();
            assert!(!error.contains("secret"), "{error}");
        }
        for address in [
            "https://host:8080/a%20b/c.esker",
            "https://host/a.esker?sig=secret",
            "http://[::1]:80/a.esker",
            "s3://bucket/a.esker",
        ] {
            locate(address, Duration::from_secs(1)).unwrap();
        }
    }
}
