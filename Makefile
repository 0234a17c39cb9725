# The project's two commands are `make demo` and `make test`; on a fresh machine each does its own set-up.

# The openusd crate declares Rust 1.96 and builds on 1.95: see "Toolchain" in README.md.
CARGO_FLAGS := --ignore-rust-version --locked
PACKAGES    := libembree-dev libopenimageio-dev openimageio-tools libclang-dev g++ pkg-config
# One build for all: cargo compiles once more for every other choice of packages, for their features differ.
BUILD_ALL   := cargo build --release --workspace --bins --examples
TARGET      := $(or $(CARGO_TARGET_DIR),target)/release
RELIEVO     := $(TARGET)/relievo
MAKE_SCENES := $(TARGET)/examples/make_scenes
OUT         := out

# What `make scenes` writes: large maps from a seed, one cage by five schemes, shells and their tiles.
ATLAS_SEAMS := scenes/atlas-seams/made
SCHEMES     := catmark loop doo-sabin butterfly sqrt3
MADE        := scenes/relief/made/relief.exr scenes/creature/made/scales.exr \
               scenes/ptex/made/colours.ptx scenes/ptex/made/heights.ptx \
               $(ATLAS_SEAMS)/atlas.usda $(ATLAS_SEAMS)/colours.exr $(ATLAS_SEAMS)/heights.exr \
               $(SCHEMES:%=scenes/schemes/made/%.usda) scenes/schemes/made/curve.svg \
               scenes/fur/made/body.usda scenes/fur/made/tile.usda \
               scenes/mail/made/cloth.usda scenes/mail/made/tile.usda

.PHONY: demo test explore bench plugin scenes fuzz leaks long-bounds budgets deps build lint clean

demo: build scenes
	mkdir -p $(OUT)
	$(RELIEVO) render scenes/first-light/first-light.usda -o $(OUT)/first-light.exr --png $(OUT)/first-light.png \
	  --stats $(OUT)/first-light.json
	@echo "The picture is $(OUT)/first-light.exr, and for looking $(OUT)/first-light.png"

build: deps
	$(BUILD_ALL) $(CARGO_FLAGS)

# Ptex for OpenImageIO's own tools and all that use it: OIIO_LIBRARY_PATH=target/plugin oiiotool --info -a some.ptx
plugin: deps
	cargo build --release $(CARGO_FLAGS) -p ptex-oiio
	mkdir -p target/plugin
	cp target/release/libptex_oiio.so target/plugin/ptex.imageio.so
	@echo "The plugin is target/plugin/ptex.imageio.so; OIIO_LIBRARY_PATH=$(CURDIR)/target/plugin lets programs find it"

# The same random cases each time: what fails then is what was changed.
test: export PROPTEST_RNG_SEED := 20261130
# Tests are compiled beside the renderer: both take minutes on one processor each.
test: BUILD_ALL := cargo test --release --workspace --no-run
test: deps scenes
	cargo test --release --workspace $(CARGO_FLAGS)

# Other cases each time, so many times over.
ROUNDS := 50
explore: deps scenes
	for round in $$(seq $(ROUNDS)); do cargo test --release $(CARGO_FLAGS) --lib || exit 1; done

# Only what is missing or older than what makes it.
scenes: $(MADE)

$(MADE): | build

scenes/relief/made/relief.exr: $(wildcard examples/make_scenes/*.rs)
	$(MAKE_SCENES) relief $@

scenes/creature/made/scales.exr: $(wildcard examples/make_scenes/*.rs)
	$(MAKE_SCENES) scales $@

scenes/fur/made/%.usda: $(wildcard examples/make_scenes/*.rs)
	$(MAKE_SCENES) fur $* $@

scenes/mail/made/%.usda: $(wildcard examples/make_scenes/*.rs)
	$(MAKE_SCENES) mail $* $@

scenes/ptex/made/%.ptx: scenes/ptex/ptex.usda $(wildcard examples/make_scenes/*.rs)
	$(MAKE_SCENES) gourd $< $* $@

$(ATLAS_SEAMS)/atlas.usda: scenes/ptex/ptex.usda src/cli/atlas.rs $(wildcard src/atlas/*.rs)
	@mkdir -p $(@D)
	$(RELIEVO) atlas $< --prim /World/Gourd --margin 8 -o $@

# Margins stay empty: the seams are what the scene is for.
$(ATLAS_SEAMS)/%.exr: scenes/ptex/made/%.ptx $(ATLAS_SEAMS)/atlas.usda scenes/atlas-seams/atlas-seams.usda \
                      $(wildcard examples/make_scenes/*.rs)
	$(MAKE_SCENES) unwrapped scenes/atlas-seams/atlas-seams.usda $< 1024 0 $@

# √3 makes three faces of one and not four: it takes two levels more.
scenes/schemes/made/%.usda: scenes/schemes/cage.obj src/cli/subdivide.rs $(wildcard src/subdiv/schemes/*.rs)
	@mkdir -p $(@D)
	$(RELIEVO) subdivide $< --scheme $* -n $(if $(filter sqrt3,$*),6,5) --limit -o $@

scenes/schemes/made/curve.svg: scenes/schemes/curve.obj
	@mkdir -p $(@D)
	$(RELIEVO) subdivide $< -n 4 -o $@

# The creature's cage is committed; this writes it anew.
scenes/creature/tortoise.usda: examples/make_scenes/tortoise.rs | build
	$(MAKE_SCENES) tortoise $@

# By the profile that all else is built by, so that macros and build scripts are compiled once, and in one folder for all.
lint: deps
	cargo fmt --all --check
	cargo clippy --release --workspace --all-targets $(CARGO_FLAGS) -- -D warnings
	RUSTDOCFLAGS="-D warnings" cargo doc --release --workspace --no-deps --document-private-items $(CARGO_FLAGS)
	cargo check --release --manifest-path fuzz/Cargo.toml --target-dir $(dir $(TARGET)) $(CARGO_FLAGS)

bench: build scenes
	cargo bench -p relievo -p relievo-ptex $(CARGO_FLAGS)

# Needs a nightly compiler; installs cargo-fuzz where it is missing. SECONDS_EACH=600 runs each target for ten minutes.
# Leaks are valgrind's business: Embree and its threads keep what they have until the process ends.
SECONDS_EACH ?= 300
fuzz: deps
	cargo fuzz --version >/dev/null 2>&1 || cargo install cargo-fuzz --locked
	cd fuzz && for target in obj ptex ptex_filter scene; do mkdir -p corpus/$$target seeds/$$target && \
	  cargo +nightly fuzz run $$target corpus/$$target seeds/$$target -- -max_total_time=$(SECONDS_EACH) \
	  -rss_limit_mb=4096 -timeout=20 -detect_leaks=0 || exit 1; done

# Lost rays: from inside of closed shapes 1e8 by each way to trace, and 1e9 by those that compress, some minutes. Then
# lost memory, which needs valgrind: definite losses in a whole render are an error.
leaks: build
	RELIEVO_EFFORT=100 cargo test --release $(CARGO_FLAGS) --lib no_ray_ -- --nocapture --test-threads=1
	RELIEVO_EFFORT=1000 cargo test --release $(CARGO_FLAGS) --lib -- --exact --nocapture --test-threads=1 \
	  accel::compact::tests::no_ray_escapes accel::compressed::tests::no_ray_escapes
	mkdir -p $(OUT)
	valgrind --leak-check=full --show-leak-kinds=definite --errors-for-leak-kinds=definite --error-exitcode=1 \
	  $(RELIEVO) render scenes/furnace/furnace.usda -o $(OUT)/leaks.exr --res 8 8 --spp 1 -t 1 --quiet

# A billion displaced points against the bounds of what they are on, ten minutes on one core.
long-bounds: deps
	RELIEVO_EFFORT=240 cargo test --release $(CARGO_FLAGS) --lib no_displaced_point_is_outside -- --nocapture

# Renders by all methods of what would take 40 GB as triangles, within 0.6 to 6 GB, and of what is advised where it does not
# fit; an hour.
budgets: deps
	RELIEVO_EFFORT=100 cargo test --release $(CARGO_FLAGS) --test main whatever_a_scene_would_take -- --nocapture

# Looks for what is missing, and installs it with apt-get where there is one.
deps:
	@sh tools/deps.sh $(PACKAGES)

clean:
	cargo clean
	rm -rf $(OUT) $(MADE)
