# Chiaro: every command that a person needs. `make help` lists them.

config ?= release
CC ?= cc
CXX ?= c++
GLSLANG ?= glslangValidator
PREFIX ?= /usr/local
SCENE ?=
-include Makefile.config

VERSION := 0.1.0
B := $(if $(filter release,$(config)),build,build/$(config))

# ---- flags -----------------------------------------------------------------------------------------------------------
WARNINGS := -Wall -Wextra -Wshadow -Wconversion -Werror
C_WARNINGS := $(WARNINGS) -Wstrict-prototypes -Wmissing-prototypes
FLAGS_release := -O2 -g -DNDEBUG
FLAGS_debug := -O0 -g
FLAGS_other := $(FLAGS_release)
FLAGS_sanitize := -O1 -g -fsanitize=address,undefined -fno-sanitize-recover=undefined
FLAGS_thread := -O1 -g -fsanitize=thread
ifeq ($(FLAGS_$(config)),)
$(error config=$(config): choose release, debug, sanitize, thread or other)
endif
# No contraction: the same bits from every compiler.
COMMON := $(FLAGS_$(config)) -fPIC -fvisibility=hidden -ffp-contract=off -fno-math-errno -MMD -MP -Iinclude -I$(B) -Iglsl
CFLAGS_ALL := -std=c11 -D_GNU_SOURCE $(C_WARNINGS) $(COMMON) $(CFLAGS)
CXXFLAGS_ALL := -std=c++17 $(WARNINGS) $(COMMON) $(CXXFLAGS)
LDFLAGS_ALL := $(FLAGS_$(config)) $(LDFLAGS)

EMBREE := $(shell test -e /usr/include/embree4/rtcore.h && echo embree4 || echo embree3)
EXR_CFLAGS := $(shell pkg-config --cflags OpenEXR 2>/dev/null)
RUNTIME_LIBS := -lm
BAKE_LIBS := -l$(EMBREE) -lm -lpthread
IO_LIBS := -ltinygltf -lOpenEXR -lOpenEXRCore -lstdc++ -lm
VULKAN_LIBS := -lvulkan
WINDOW_LIBS := -lglfw

# ---- what is built ---------------------------------------------------------------------------------------------------
objects = $(patsubst %,$(B)/obj/%.o,$(basename $(1)))

CORE := $(call objects,$(wildcard src/core/*.c))
VULKAN := $(call objects,$(wildcard src/vulkan/*.c))
OFFLINE := $(call objects,$(wildcard src/offline/*.c))
BAKE := $(call objects,$(wildcard src/bake/*.c))
REFERENCE := $(call objects,$(wildcard src/reference/*.c))
IO := $(call objects,$(wildcard src/io/*.c src/io/*.cpp))
COMMON_SAMPLES := $(call objects,$(wildcard samples/common/*.c))
PROGRAMS := $(patsubst samples/%.c,$(B)/bin/%,$(wildcard samples/chiaro-*.c))
EMBEDS := $(patsubst samples/%.c,$(B)/bin/%,$(wildcard samples/embed_*.c))
TESTS := $(patsubst tests/test_%.c,$(B)/tests/test_%,$(wildcard tests/test_*.c))
TEST_COMMON := $(call objects,$(wildcard tests/common/*.c))
SPIRV := $(patsubst glsl/%.glsl,$(B)/spirv/%.spv,$(wildcard glsl/*.comp.glsl) $(wildcard glsl/*.vert.glsl) $(wildcard glsl/*.frag.glsl))

SAMPLE_SHADERS := $(patsubst samples/shaders/%.glsl,$(B)/shaders/%.h,$(wildcard samples/shaders/*.vert.glsl samples/shaders/*.frag.glsl))

LIBRARY := $(B)/libchiaro.a
PLUGIN := $(B)/chiaro_plugin.so
SHARED := $(B)/libchiaro.so.$(VERSION)
BAKE_LIBRARY := $(B)/libchiaro_bake.a

.PHONY: all help deps test stability other bench pictures report demo doc install clean shaders
all: $(LIBRARY) $(SHARED) $(PLUGIN) $(BAKE_LIBRARY) $(PROGRAMS) $(EMBEDS)

help: ## this list
	@echo 'make            build the library and the programs (config=release|debug|sanitize|thread)'
	@sed -n 's/^\([a-z-]*\):.*## \(.*\)/make \1|\2/p' $(MAKEFILE_LIST) | \
	 while IFS='|' read -r target text; do printf '%-16s%s\n' "$$target" "$$text"; done

# ---- packages --------------------------------------------------------------------------------------------------------
PACKAGES := gcc g++ make pkg-config glslang-tools libvulkan-dev mesa-vulkan-drivers vulkan-validationlayers \
  libembree-dev libtbb-dev libtinygltf-dev nlohmann-json3-dev libstb-dev libopenexr-dev libglfw3-dev libcmocka-dev doxygen \
  xvfb libx11-dev libxtst-dev $(if $(filter test stability,$(MAKECMDGOALS)),clang) # tests compare two compilers
MISSING = $(shell for p in $(PACKAGES); do \
  dpkg-query -W -f='$${db:Status-Status}' $$p 2>/dev/null | grep -qx installed || echo $$p; done)

# Everything after it starts afresh: what a package brings (which Embree, say) is looked up when make reads this file.
deps: ## install what is missing, through apt
	@missing="$(MISSING)"; if [ -n "$$missing" ]; then echo "installing: $$missing"; \
	  if [ "$$(id -u)" = 0 ]; then as_root=; else as_root=sudo; fi; \
	  $$as_root apt-get update -qq && \
	  $$as_root env DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends $$missing; fi

ifneq ($(filter deps,$(MAKECMDGOALS)),)
AFTER_DEPS := $(filter-out deps,$(MAKECMDGOALS))
.NOTPARALLEL:
$(AFTER_DEPS): deps
	@$(MAKE) --no-print-directory $@
.PHONY: $(AFTER_DEPS)
else

# ---- rules -----------------------------------------------------------------------------------------------------------
$(B)/obj/src/io/%.o $(B)/obj/samples/%.o $(B)/obj/tests/%.o: CFLAGS_ALL += $(EXR_CFLAGS)
ifeq ($(config),release)
$(B)/obj/src/bake/%.o $(addprefix $(B)/obj/src/core/,world_paint.o world_near.o cube_paint.o): CFLAGS_ALL += -O3
endif
# Small where it is loaded: what is not reached goes, and nothing unwinds through C.
$(CORE) $(VULKAN): CFLAGS_ALL += -ffunction-sections -fdata-sections -fno-unwind-tables -fno-asynchronous-unwind-tables
$(B)/obj/src/offline/%.o: CFLAGS_ALL += -DCHIARO_EMBREE=$(subst embree,,$(EMBREE))

$(B)/obj/%.o: %.c
	@mkdir -p $(@D)
	$(CC) $(CFLAGS_ALL) -c $< -o $@

$(B)/obj/%.o: %.cpp
	@mkdir -p $(@D)
	$(CXX) $(CXXFLAGS_ALL) -c $< -o $@

$(B)/spirv/%.spv: glsl/%.glsl
	@mkdir -p $(@D)
	@printf '%s: %s\n' $@ "$$(ls glsl/* | tr '\n' ' ')" > $@.d
	$(GLSLANG) --quiet -V -g0 --target-env vulkan1.1 -Iglsl -o $@ $<

$(B)/spirv/shaders.h: $(SPIRV) $(B)/bin/pack-shaders
	$(B)/bin/pack-shaders $@ $(SPIRV)

$(B)/bin/pack-shaders: $(B)/obj/src/tools/pack_shaders.o
	@mkdir -p $(@D)
	$(CC) $(LDFLAGS_ALL) -o $@ $^

shaders: $(B)/spirv/shaders.h ## compile the shaders
$(VULKAN): | $(B)/spirv/shaders.h

# Shaders of the programs: the library knows nothing of them.
$(B)/shaders/%.h: samples/shaders/%.glsl
	@mkdir -p $(@D)
	@printf '%s: %s\n' $@ "$$(ls glsl/* samples/shaders/* | tr '\n' ' ')" > $@.d
	$(GLSLANG) --quiet -V --target-env vulkan1.1 -Iglsl --vn sample_$(subst .,_,$*) -o $@ $<

$(COMMON_SAMPLES): | $(SAMPLE_SHADERS)

$(LIBRARY): $(CORE) $(VULKAN)
	rm -f $@ && ar rcs $@ $^

$(SHARED): $(CORE) $(VULKAN)
	$(CC) $(LDFLAGS_ALL) -shared -Wl,-soname,libchiaro.so.0 -Wl,--no-undefined -o $@ $^ $(RUNTIME_LIBS)
	ln -sf $(@F) $(B)/libchiaro.so.0 && ln -sf $(@F) $(B)/libchiaro.so

# What hosts load with dlopen: the same objects, one symbol, and none of what it does not reach.
$(PLUGIN): $(CORE) $(VULKAN) src/vulkan/plugin.map
	$(CC) $(LDFLAGS_ALL) -shared -Wl,-soname,$(@F) -Wl,--version-script=src/vulkan/plugin.map -Wl,--gc-sections -Wl,-z,noseparate-code \
	  -o $@ $(CORE) $(VULKAN) $(RUNTIME_LIBS)

$(BAKE_LIBRARY): $(BAKE) $(OFFLINE)
	rm -f $@ && ar rcs $@ $^

$(B)/bin/%: $(B)/obj/samples/%.o $(COMMON_SAMPLES) $(REFERENCE) $(IO) $(BAKE_LIBRARY) $(LIBRARY)
	@mkdir -p $(@D)
	$(CC) $(LDFLAGS_ALL) -o $@ $^ $(BAKE_LIBS) $(IO_LIBS) $(VULKAN_LIBS)
$(B)/bin/chiaro-view: VULKAN_LIBS += $(WINDOW_LIBS)

# Shaders of a host that draws itself; they include Chiaro's.
LIGHT_SHADERS := $(patsubst samples/embed_light/%.glsl,$(B)/spirv/embed_light/%.h,$(wildcard samples/embed_light/*.*.glsl))
$(B)/spirv/embed_light/%.h: samples/embed_light/%.glsl $(wildcard glsl/*.glsl glsl/*.h) samples/embed_light/shared.glsl
	@mkdir -p $(@D)
	$(GLSLANG) --quiet -V --target-env vulkan1.1 -Iglsl -Isamples/embed_light --vn $(subst .,_,$*)_code -o $@ $<
$(B)/obj/samples/embed_light.o: $(LIGHT_SHADERS)

# Hosts that load the plugin link nothing of Chiaro: only what an engine has anyhow.
EMBED_OBJECTS := $(call objects,samples/common/device.c src/io/file.c src/io/png.c)
$(EMBEDS): $(B)/bin/%: $(B)/obj/samples/%.o $(EMBED_OBJECTS)
	@mkdir -p $(@D)
	$(CC) $(LDFLAGS_ALL) -o $@ $^ -ldl -lpthread -lm $(VULKAN_LIBS)

$(B)/tests/%: $(B)/obj/tests/%.o $(TEST_COMMON) $(COMMON_SAMPLES) $(REFERENCE) $(IO) $(BAKE_LIBRARY) $(LIBRARY)
	@mkdir -p $(@D)
	$(CC) $(LDFLAGS_ALL) -o $@ $^ -lcmocka $(BAKE_LIBS) $(IO_LIBS) $(VULKAN_LIBS)

# What a program under the address sanitizer loads stays loaded (tests/run.sh).
KEEP_LOADED := $(if $(filter sanitize,$(config)),$(B)/tests/keep_loaded.so)
$(B)/tests/keep_loaded.so: tests/sanitize/keep_loaded.c
	@mkdir -p $(@D)
	$(CC) -std=c11 $(C_WARNINGS) -fPIC -shared -o $@ $<

$(B)/tests/test_view: VULKAN_LIBS += -lstb -lX11 -lXtst
$(B)/spirv/tests/%.h: tests/glsl/%.glsl $(wildcard glsl/*.glsl glsl/*.h)
	@mkdir -p $(@D)
	$(GLSLANG) --quiet -V --target-env vulkan1.1 -Iglsl --vn $(subst .,_,$*)_code -o $@ $<
$(addprefix $(B)/obj/tests/test_vulkan_,light.o cycles.o budget.o): $(B)/spirv/tests/unshadowed.comp.h
$(B)/tests/test_old_host: $(B)/obj/tests/abi/new_host.o
$(addprefix $(B)/tests/test_,plugin old_host embed): | $(PLUGIN) $(EMBEDS)

# ---- jobs ------------------------------------------------------------------------------------------------------------
test: all $(TESTS) $(KEEP_LOADED) other ## build and run every test (config=sanitize, config=thread: 0 reports)
	@tests/run.sh $(B)

stability: $(filter %/test_stability_%,$(TESTS)) other ## the table of extreme cases: expected, got, error, pass or fail
	@tests/run.sh $(B) stability > $(B)/tests/stability.txt 2>&1; status=$$?; \
	 grep -v '^\[' $(B)/tests/stability.txt; exit $$status

# The same program from the other compiler, if there is one, to compare bits with.
OTHER_CC := $(if $(findstring clang,$(shell $(CC) --version)),gcc,clang)
other:
	@if command -v $(OTHER_CC) > /dev/null; then $(MAKE) --no-print-directory config=other CC=$(OTHER_CC) \
	  build/other/tests/test_stability_compilers; fi

demo: all ## the main job [SCENE=file.glb] [OPTIONS='--light ...']: bake, render, trace, compare; pictures in build/demo
	@samples/demo.sh $(B) "$(SCENE)" $(OPTIONS)

report: all ## error against run time as a page [SCENE=file.glb] [OPTIONS='--quick --suggest 16']: build/report/index.html
	@mkdir -p $(B)/report
	@[ -n "$(SCENE)" ] || $(B)/bin/chiaro-scene cornell -o $(B)/report/cornell.glb
	@mkdir -p $(B)/report/cache && XDG_CACHE_HOME=$(abspath $(B))/report/cache $(B)/bin/chiaro-report \
	 $(if $(SCENE),"$(SCENE)",$(B)/report/cornell.glb) \
	 -o $(B)/report $(OPTIONS)

bench: all ## error and cost: K = 8 .. 64 beside three baselines, cubes, objects, 1,000 of them beside the article's form
	@rm -rf $(B)/bench/chiaro # bakes are timed
	@VK_DRIVER_FILES=$${VK_DRIVER_FILES:-$$(ls /usr/share/vulkan/icd.d/lvp_icd*.json | head -n 1)} \
	 XDG_CACHE_HOME=$(abspath $(B))/bench $(B)/bin/chiaro-bench $(B)/bench
	@$(B)/bin/chiaro-bench-cubes
	@$(B)/bin/chiaro-bench-objects
	@samples/pictures.sh $(B)

pictures: all ## moving objects beside the path tracer: pictures in build/report, errors, frame times [SCENE=.. PLACES=..]
	@SCENE='$(SCENE)' PLACES='$(PLACES)' OPTIONS='$(OPTIONS)' samples/pictures.sh $(B)

endif

doc: ## the API reference, from the headers: build/doc/html/index.html
	@mkdir -p build/doc
	@{ cat include/Doxyfile; echo 'PROJECT_NUMBER = $(VERSION)'; echo 'OUTPUT_DIRECTORY = build/doc'; } | doxygen -
	@echo build/doc/html/index.html

install: all ## install into PREFIX (default /usr/local; DESTDIR is honoured)
	install -d $(DESTDIR)$(PREFIX)/include/chiaro $(DESTDIR)$(PREFIX)/lib/pkgconfig $(DESTDIR)$(PREFIX)/bin \
	  $(DESTDIR)$(PREFIX)/share/chiaro/glsl
	install -m 644 include/chiaro/*.h $(DESTDIR)$(PREFIX)/include/chiaro/
	install -m 644 glsl/chiaro.glsl glsl/chiaro_shared.h glsl/samples.glsl glsl/gi.glsl $(DESTDIR)$(PREFIX)/share/chiaro/glsl/
	install -m 644 $(LIBRARY) $(BAKE_LIBRARY) $(DESTDIR)$(PREFIX)/lib/
	install -m 755 $(SHARED) $(PLUGIN) $(DESTDIR)$(PREFIX)/lib/
	ln -sf $(notdir $(SHARED)) $(DESTDIR)$(PREFIX)/lib/libchiaro.so.0
	ln -sf $(notdir $(SHARED)) $(DESTDIR)$(PREFIX)/lib/libchiaro.so
	install -m 755 $(PROGRAMS) $(DESTDIR)$(PREFIX)/bin/
	printf 'prefix=%s\nName: chiaro\nDescription: diffuse global illumination for any C engine\nVersion: %s\nCflags: -I$${prefix}/include\nLibs: -L$${prefix}/lib -lchiaro -lm\n' \
	  '$(PREFIX)' '$(VERSION)' > $(DESTDIR)$(PREFIX)/lib/pkgconfig/chiaro.pc

clean: ## remove everything that was built
	rm -rf build

.SECONDARY:

-include $(shell find $(B)/obj $(B)/spirv $(B)/shaders -name '*.d' 2>/dev/null)
