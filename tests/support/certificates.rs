//! Certificates for one test: an authority, and the certificates that it signs.

#![allow(dead_code, unreachable_pub, reason = "each test takes what it needs")]

use rcgen::{
    BasicConstraints, CertificateParams, DnType, ExtendedKeyUsagePurpose, IsCa, Issuer, KeyPair,
    date_time_ymd,
};

/// Certificate and key as PEM text.
#[derive(Clone)]
pub struct Signed {
    pub cert: String,
    pub key: String,
}

/// Authority that signs certificates.
pub struct Authority {
    pub cert: String,
    issuer: Issuer<'static, KeyPair>,
}

impl Authority {
    pub fn new() -> Authority {
        Authority::named("authority")
    }

    pub fn named(name: &str) -> Authority {
        let key = KeyPair::generate().unwrap();
        let mut params = CertificateParams::new(Vec::new()).unwrap();
        params.is_ca = IsCa::Ca(BasicConstraints::Unconstrained);
        params.distinguished_name.push(DnType::CommonName, name);
        let cert = params.self_signed(&key).unwrap().pem();
        Authority { cert, issuer: Issuer::new(params, key) }
    }

    /// Creates a certificate for this name, valid from one year to another.
    pub fn signs(&self, name: &str, years: (i32, i32)) -> Signed {
        let (params, key) = (params(name, years), KeyPair::generate().unwrap());
        let cert = params.signed_by(&key, &self.issuer).unwrap().pem();
        Signed { cert, key: key.serialize_pem() }
    }
}

/// Creates a self-signed certificate that is also an authority, as `openssl req -x509` and many devices do.
pub fn signs_itself(name: &str, years: (i32, i32)) -> Signed {
    let (mut params, key) = (params(name, years), KeyPair::generate().unwrap());
    params.is_ca = IsCa::Ca(BasicConstraints::Unconstrained);
    Signed { cert: params.self_signed(&key).unwrap().pem(), key: key.serialize_pem() }
}

fn params(name: &str, (from, to): (i32, i32)) -> CertificateParams {
    let mut params = CertificateParams::new([name.to_owned()]).unwrap();
    // OpenSSL takes a certificate with the name of its issuer for a self-signed one.
    params.distinguished_name.push(DnType::CommonName, name);
    params.extended_key_usages =
        vec![ExtendedKeyUsagePurpose::ServerAuth, ExtendedKeyUsagePurpose::ClientAuth];
    (params.not_before, params.not_after) = (date_time_ymd(from, 1, 1), date_time_ymd(to, 1, 1));
    params
}
