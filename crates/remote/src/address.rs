//! What an address names: a store, and a path in it. Stores get their credentials from the standard
//! variables of the environment, and read without any where there are none.

use crate::threads::choose_tls;
use object_store::aws::AmazonS3Builder;
use object_store::azure::MicrosoftAzureBuilder;
use object_store::gcp::GoogleCloudStorageBuilder;
use object_store::http::HttpBuilder;
use object_store::path::Path;
use object_store::{BackoffConfig, ClientOptions, ObjectStore, RetryConfig};
use std::env::var_os;
use std::io;
use std::sync::Arc;
use std::time::Duration;
use url::Url;

/// A store and a path in it.
pub type Place = (Arc<dyn ObjectStore>, Path);

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

/// Finds what an address names; nothing is read. `request` is the longest time for an answer.
///
/// # Errors
/// If it is no address, has a password or a query, or its store is not known or not configured.
pub fn place(address: &str, request: Duration) -> io::Result<Place> {
    let invalid = |what: String| io::Error::new(io::ErrorKind::InvalidInput, what);
    let url = Url::parse(address).map_err(|e| invalid(format!("is no valid address: {e}")))?;
    if !url.username().is_empty() || url.password().is_some() {
        return Err(invalid(
            "has a user or a password in it, which messages would show; give credentials by the \
             variables of the environment"
                .into(),
        ));
    }
    if url.query().is_some() || url.fragment().is_some() {
        return Err(invalid("has a `?` or a `#`, which are not supported in addresses".into()));
    }
    choose_tls();
    let path = Path::from_url_path(url.path()).map_err(|e| invalid(e.to_string()))?;
    let has = |names: &[&str]| names.iter().any(|name| var_os(name).is_some());
    let options = ClientOptions::new().with_timeout(request).with_connect_timeout(CONNECT);
    let retry = RetryConfig {
        backoff: BackoffConfig {
            init_backoff: Duration::from_millis(100),
            max_backoff: Duration::from_secs(5),
            base: 2.0,
        },
        max_retries: 5,
        retry_timeout: 2 * request,
    };
    let store: Result<Arc<dyn ObjectStore>, _> = match url.scheme() {
        "http" | "https" => {
            let options = options.with_allow_http(url.scheme() == "http");
            let origin = &url[..url::Position::BeforePath];
            let http = HttpBuilder::new().with_url(origin).with_client_options(options);
            http.with_retry(retry).build().map(|s| Arc::new(s) as _)
        }
        "s3" | "s3a" => {
            let s3 = AmazonS3Builder::from_env().with_url(address);
            let options = options.with_allow_http(var_os("AWS_ALLOW_HTTP").is_some());
            let s3 = s3.with_client_options(options).with_retry(retry);
            s3.with_skip_signature(!has(&AWS)).build().map(|s| Arc::new(s) as _)
        }
        "gs" => {
            let gcs = GoogleCloudStorageBuilder::from_env().with_url(address);
            let gcs = gcs.with_client_options(options).with_retry(retry);
            gcs.with_skip_signature(!has(&GOOGLE)).build().map(|s| Arc::new(s) as _)
        }
        "az" | "azure" | "abfs" | "abfss" => {
            let azure = MicrosoftAzureBuilder::from_env().with_url(address);
            let azure = azure.with_client_options(options).with_retry(retry);
            azure.with_skip_signature(!has(&AZURE)).build().map(|s| Arc::new(s) as _)
        }
        other => {
            return Err(invalid(format!(
                "`{other}://` is not read; http, https, s3, gs and az are"
            )));
        }
    };
    Ok((store.map_err(|e| invalid(format!("cannot be reached: {e}")))?, path))
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests may panic")]
mod tests {
    use super::*;

    #[test]
    fn addresses_that_would_show_secrets_and_unknown_ones_are_refused_without_them() {
        for address in [
            "https://user:secret@host/a.esker",
            "https://host/a.esker?sig=secret",
            "https://host/a.esker#secret",
            "ftp://host/a.esker",
            "https://",
        ] {
            let error = place(address, Duration::from_secs(1)).unwrap_err().to_string();
            assert!(!error.contains("secret"), "{error}");
        }
        place("https://host:8080/a%20b/c.esker", Duration::from_secs(1)).unwrap();
        place("s3://bucket/a.esker", Duration::from_secs(1)).unwrap();
    }
}
