//! The last guard of credentials: their values are taken out of messages, whoever wrote these.

use std::io;

/// Words in the names of variables whose values are secret.
const SECRET: [&str; 5] = ["KEY", "TOKEN", "SECRET", "PASSWORD", "PROXY"];
/// Beginnings of the names of variables that stores and connections read.
const READ: [&str; 8] =
    ["AWS_", "AZURE_", "GOOGLE_", "SERVICE_", "HTTP_", "HTTPS_", "ALL_", "MSI_"];
/// Shortest value that is taken out.
const LETTERS_MIN: usize = 6;

/// An error whose message has no value of a secret variable.
pub fn without(error: io::Error) -> io::Error {
    let secrets = std::env::vars_os().filter_map(|(name, value)| {
        let name = name.to_str()?.to_ascii_uppercase();
        let is_secret = READ.iter().any(|start| name.starts_with(start))
            && SECRET.iter().any(|word| name.contains(word));
        value.into_string().ok().filter(|value| is_secret && value.len() >= LETTERS_MIN)
    });
    let text = error.to_string();
    let clean = hidden(&text, secrets);
    if clean == text { error } else { io::Error::new(error.kind(), clean) }
}

fn hidden(text: &str, secrets: impl Iterator<Item = String>) -> String {
    secrets.fold(text.to_owned(), |text, secret| text.replace(&secret, "***"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_of_secrets_are_hidden_wherever_they_are() {
        let secrets = || ["sesame".to_owned(), "open it".to_owned()].into_iter();
        assert_eq!(hidden("key sesame, sesame: open it", secrets()), "key ***, ***: ***");
        assert_eq!(hidden("there is no such file", secrets()), "there is no such file");
    }
}
