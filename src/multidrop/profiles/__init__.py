"""Device models as data, one TOML file each; `multidrop.catalog` reads them."""
