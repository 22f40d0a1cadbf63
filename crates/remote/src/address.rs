//! What an address names: a store, and a path in it. Stores get their credentials from the standard
//! variables of the environment, and read without any where there are none.

use crate::connection::Connector;
use crate::fetch::deepest;
use crate::threads::choose_tls;
use object_store::aws::AmazonS3Builder;
use object_store::azure::MicrosoftAzureBuilder;
use object_store::gcp::GoogleCloudStorageBuilder;
use object_store::http::HttpBuilder;
use object_store::path::Path;
use object_store::{ClientOptions, ObjectStore, RetryConfig};
use std::env::{var, var_os};
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
/// If it is no address, has a password, or a query for a store, or its store is not known or not
/// configured.
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
    let is_http = matches!(url.scheme(), "http" | "https");
    if (url.query().is_some() && !is_http) || url.fragment().is_some() {
        return Err(invalid("has a `?` or a `#`, which have no meaning there".into()));
    }
    if url.path().to_ascii_lowercase().contains("%2f") {
        return Err(invalid("has an encoded `/`, which is not supported in addresses".into()));
    }
    choose_tls();
    let path = Path::from_url_path(url.path()).map_err(|e| invalid(e.to_string()))?;
    let has = |names: &[&str]| names.iter().any(|name| var_os(name).is_some());
    // A long answer over a slow line is no fault: what counts is that bytes keep coming.
    let options = ClientOptions::new().with_timeout_disabled().with_read_timeout(request);
    let options = options.with_connect_timeout(CONNECT.min(request));
    // Requests are repeated by those who make them.
    let retry = RetryConfig { max_retries: 0, ..RetryConfig::default() };
    let store: Result<Arc<dyn ObjectStore>, _> = match url.scheme() {
        "http" | "https" => {
            let options = options.with_allow_http(url.scheme() == "http");
            // The store puts the path before the query.
            let mut origin = url.clone();
            origin.set_path("");
            let http = HttpBuilder::new().with_url(origin).with_client_options(options);
            let http = http.with_http_connector(Connector);
            http.with_retry(retry).build().map(|s| Arc::new(s) as _)
        }
        "s3" | "s3a" => {
            let s3 = AmazonS3Builder::from_env().with_url(address);
            let is_allowed = var("AWS_ALLOW_HTTP").is_ok_and(|word| is_yes(&word));
            let options = options.with_allow_http(is_allowed);
            let s3 = s3.with_client_options(options).with_retry(retry);
            let s3 = s3.with_http_connector(Connector);
            s3.with_skip_signature(!has(&AWS)).build().map(|s| Arc::new(s) as _)
        }
        "gs" => {
            let gcs = GoogleCloudStorageBuilder::from_env().with_url(address);
            let gcs = gcs.with_client_options(options).with_retry(retry);
            let gcs = gcs.with_http_connector(Connector);
            gcs.with_skip_signature(!has(&GOOGLE)).build().map(|s| Arc::new(s) as _)
        }
        "az" | "azure" | "abfs" | "abfss" => {
            let azure = MicrosoftAzureBuilder::from_env().with_url(address);
            let azure = azure.with_client_options(options).with_retry(retry);
            let azure = azure.with_http_connector(Connector);
            azure.with_skip_signature(!has(&AZURE)).build().map(|s| Arc::new(s) as _)
        }
        other => {
            return Err(invalid(format!(
                "`{other}://` is not read; http, https, s3, gs and az are"
            )));
        }
    };
    Ok((store.map_err(|e| invalid(format!("cannot be reached: {}", deepest(&e))))?, path))
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
            let error = place(address, Duration::from_secs(1)).unwrap_err().to_string();
            assert!(!error.contains("secret"), "{error}");
        }
        for address in [
            "https://host:8080/a%20b/c.esker",
            "https://host/a.esker?sig=secret",
            "http://[::1]:80/a.esker",
            "s3://bucket/a.esker",
        ] {
            place(address, Duration::from_secs(1)).unwrap();
        }
    }
}
