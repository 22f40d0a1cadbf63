//! Connections to servers. What a server writes about a refusal is dropped before anything reads
//! it: it may repeat credentials that were sent (S3 repeats a session token that has expired), and
//! may have any length.

use async_trait::async_trait;
use bytes::Bytes;
use object_store::ClientOptions;
use object_store::client::{
    HttpClient, HttpConnector, HttpError, HttpRequest, HttpResponse, HttpService, ReqwestConnector,
};

/// Makes connections.
#[derive(Debug)]
pub struct Connector;

impl HttpConnector for Connector {
    fn connect(&self, options: &ClientOptions) -> object_store::Result<HttpClient> {
        Ok(HttpClient::new(WithoutRefusals(ReqwestConnector::default().connect(options)?)))
    }
}

/// Answers, without the bodies of refusals.
#[derive(Debug)]
struct WithoutRefusals(HttpClient);

#[async_trait]
impl HttpService for WithoutRefusals {
    async fn call(&self, request: HttpRequest) -> Result<HttpResponse, HttpError> {
        let response = self.0.execute(request).await?;
        if response.status().is_success() {
            return Ok(response);
        }
        let (parts, _) = response.into_parts();
        Ok(HttpResponse::from_parts(parts, Bytes::new().into()))
    }
}
