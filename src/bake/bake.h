/* Inside the baker: the stages and what they hand on.
 *
 *   patches    triangles -> small triangles -> samples, points, leaves and the tree
 *   rows       rays from a place -> a row of form factors over the leaves, and what else the rays tell (cavity)
 *   mesh       subdivision without T-junctions -> vertices and receivers
 *   training   lights that could be: their direct light on the samples
 *   solve      (I - rho F) B = x, many right-hand sides, at any albedo below 1
 *   links      rows -> blocks of links: patterns, a cut through the tree, weights fitted on the training lights, energy kept;
 *              first those between samples, last those of receivers
 *   more lights between the two: those whose bounces the samples' links give, for the receivers to be fitted on
 *   write      all of it -> one block of bytes
 */
#ifndef CHIARO_BAKE_INTERNAL_H
#define CHIARO_BAKE_INTERNAL_H

#include "../core/transport.h"
#include "../core/vec.h"
#include "../offline/rays.h"
#include "chiaro/chiaro_bake.h"

/* Training lights are solved in blocks of this many. */
enum { CHIARO_COLUMN_BLOCK = 32, CHIARO_SPREAD = 8 };

/* Sparse row of form factors: leaves, in their order, and the share of the cosine hemisphere that each takes. */
typedef struct RowEntry {
    uint32_t node; /* a leaf: the first nodes are the leaves */
    float weight;
} RowEntry;

/* What a set of rays found apart from the leaves. */
typedef struct RowFacts {
    float sky;         /* share that left the scene */
    float behind;      /* share that hit surfaces from behind */
    float free_path;   /* harmonic mean of the distances */
    Vec3 bent;         /* cosine-weighted mean direction of the free rays, not normalised */
    Vec3 cavity;       /* cavity colour */
} RowFacts;

/* Small triangles: a regular lattice of edge `n` in each triangle of the scene. */
typedef struct Patches {
    uint32_t *triangle_first; /* first small triangle of a scene triangle */
    uint16_t *triangle_edge;  /* n; 0: the triangle has no area */
    uint32_t *small_leaf;     /* leaf of each small triangle */
    uint32_t *leaf_small;     /* small triangles in the order of leaves */
    uint32_t *leaf_first;     /* run of leaf_small, sample_count + 1 */
    uint32_t *small_triangle; /* scene triangle of each small triangle */
    uint32_t *triangle_part;
    double *leaf_cumulative; /* area before each entry of leaf_small, for picking places */
    uint32_t small_count, degenerate;
    float emitter_boost; /* small emitters count this much more when leaves are dealt out */
    double area;
} Patches;

/* ChiaroLinks in the making. */
typedef struct LinkTable {
    ChiaroBlock *blocks;
    uint32_t *nodes;
    float *weights;
    uint32_t block_count, node_count, weight_count;
} LinkTable;

/* Everything that the stages share. Arrays that end up in the file have the file's types. */
typedef struct Baker {
    const ChiaroScene *scene;
    ChiaroBakeDesc desc; /* resolved */
    ChiaroRays *rays;
    float free_path; /* of the scene: mean distance that light travels, m */
    Patches patches;

    ChiaroSample *samples;
    ChiaroPoint *points;
    float *leaf_weights, *sky_directions;
    uint32_t *sky_order; /* place of each texel of the sky's cube among the sky leaves */
    ChiaroNode *nodes;
    uint32_t sample_count, point_count, sky_count, leaf_count, node_count, small_node_end, root;

    /* rows of the samples: entries row_first[i] .. row_first[i + 1] */
    size_t *row_first;
    RowEntry *rows;
    uint32_t sample_rays;

    /* drawn mesh */
    ChiaroVertex *vertices;
    uint32_t *vertex_receivers, *indices;
    ChiaroPart *parts;
    ChiaroReceiver *receivers;
    Vec3 *receiver_plane; /* geometric normal at each receiver */
    Vec3 *receiver_spread; /* CHIARO_SPREAD places about each receiver, where its rays start */
    float *receiver_share; /* what each counts: 1, or less where detail is finer than it need be for its light */
    uint32_t vertex_count, index_count, receiver_count;

    /* training: one column a light, one channel each; tables are [node][column], columns a multiple of the block */
    uint32_t columns, used_columns;
    uint32_t emitter_column, uniform_column, uniform_sky_column; /* the first of three each */
    uint8_t *column_channel;
    bool grey;         /* no colour anywhere: one channel stands for all */
    float *direct;     /* radiosity straight from the lights (x) */
    float *total;      /* with all bounces, as solved (B) */
    float *carried;    /* with all bounces, as the sample links carry it at run time */
    float *irradiance; /* [sample][column]: F B */
    /* More lights, which receivers alone are taught: what the sample links make of their light is truth enough. */
    uint32_t more_columns;
    float *more; /* [node][column]: carried */

    /* the system on clusters of samples (nodes), see solve.c */
    uint32_t *clusters, *sample_cluster, cluster_count; /* nodes; the cluster of each sample */
    double *response[3];

    uint32_t *receiver_runs, receiver_run_count; /* first receiver of each run of neighbours, and one more */
    LinkTable sample_links, receiver_links;
    ChiaroTransportInfo info;

    const char *stage; /* progress: */
    float stage_begin, stage_end;
} Baker;

/* Each stage returns CHIARO_OK, CHIARO_ERROR_MEMORY, _SCENE or _INTERRUPTED; what it allocated hangs on the baker. */
ChiaroResult chiaro_bake_patches(Baker *baker);
ChiaroResult chiaro_bake_rows(Baker *baker);
ChiaroResult chiaro_bake_mesh(Baker *baker);
ChiaroResult chiaro_bake_training(Baker *baker);
ChiaroResult chiaro_bake_solve(Baker *baker);
ChiaroResult chiaro_bake_sample_links(Baker *baker);
ChiaroResult chiaro_bake_more_lights(Baker *baker);
ChiaroResult chiaro_bake_receiver_links(Baker *baker);
ChiaroResult chiaro_bake_write(Baker *baker, ChiaroBlob *blob);

/* --- patches.c --- */
/* Leaf of a place on a triangle, CHIARO_NONE for a triangle without area. */
uint32_t chiaro_patches_leaf(const Patches *patches, uint32_t triangle, float u, float v);
/* A place on the patch of a sample from numbers in [0, 1). */
void chiaro_patches_place(const Baker *baker, uint32_t sample, float pick, float u, float v, Vec3 *place, Vec3 *normal);
/* Leaf of a direction into the sky. */
uint32_t chiaro_sky_leaf(const Baker *baker, Vec3 direction);

/* --- cluster.c --- */
/* A cloud of weighted things, cut into a binary tree of groups. Features say how alike two things are; the first of them are
 * their places. */
enum { CLUSTER_PLACE = 4, CLUSTER_FEATURES = 10 };
typedef struct ClusterItem {
    float feature[CLUSTER_FEATURES];
    float weight; /* groups are to be about equally heavy ... */
    float unit;   /* ... and not much larger than this */
} ClusterItem;
typedef struct ClusterNode {
    uint32_t first, count; /* run of `order` */
    uint32_t left, right;  /* CHIARO_NONE for a leaf */
    uint32_t leaf_first, leaf_count;
} ClusterNode;
typedef struct ClusterTree {
    uint32_t *order;
    ClusterNode *nodes; /* nodes[0] is the root, in depth-first order: children follow their parent */
    uint32_t node_count, leaf_count;
} ClusterTree;
/* What does not belong together in a group, however alike it is: moves the items of a run that go left to its front and
 * returns their number; 0: the group is good as it is. Several threads ask at once. */
typedef uint32_t (*ClusterSplit)(uint32_t *order, uint32_t count, void *user);
typedef struct ClusterDesc {
    const ClusterItem *items;
    uint32_t count, threads;
    uint32_t leaves;    /* groups that are made, at most, */
    uint32_t most;      /* then more, until none has more than so many items; */
    ClusterSplit split; /* then those that this makes (may be NULL), where they are too many of fewer groups */
    void *user;
} ClusterDesc;
bool chiaro_cluster(const ClusterDesc *desc, ClusterTree *tree);
void chiaro_cluster_free(ClusterTree *tree);

/* --- rows.c --- */
/* One a thread: counts of rays a leaf (all 0 between rows), and the row that came out last. */
typedef struct RowScratch {
    uint32_t *counts, *touched;
    RowEntry *entries; /* room for one a ray */
} RowScratch;
bool chiaro_row_scratch_create(const Baker *baker, uint32_t rays, RowScratch *scratch);
void chiaro_row_scratch_destroy(RowScratch *scratch);
/* Row into scratch->entries: rays (a power of two) from `count` places in turns, about `normal`, mirrored above the plane
 * whose normal is `plane`. Returns the number of entries. */
uint32_t chiaro_row_trace(const Baker *baker, const Vec3 *places, uint32_t count, Vec3 normal, Vec3 plane, uint32_t rays,
                          uint32_t stream, RowScratch *scratch, RowFacts *facts);
/* The same for a sample: rays start all over its patch. */
uint32_t chiaro_row_trace_sample(const Baker *baker, uint32_t sample, uint32_t rays, RowScratch *scratch,
                                 RowFacts *facts);

/* --- training.c --- */
/* Fills rows [leaf_count, node_count) of a nodes x columns table with the weighted means of the leaves' rows. */
void chiaro_bake_tree_sum(const Baker *baker, float *table, uint32_t columns);

/* --- solve.c --- */
/* What training lights are multiplied with, so that their light on the surfaces has mean square 1: a bright lamp teaches no
 * more than a dim one, and a lamp against a wall, nearly all of whose light is one spot, no more than one in the open. A
 * light that reaches no surface (a sky from below the ground) teaches nothing: 0. direct: [leaf][column]; irradiance:
 * [sample][column]. */
void chiaro_bake_column_scales(const Baker *baker, const float *direct, const float *irradiance, uint32_t columns,
                               float *scale);

/* --- links.c --- */
/* What the sample links make of direct light, at every sample. direct: [node][column]; channel: of each column;
 * irradiance: [sample][column]. */
ChiaroResult chiaro_bake_gather(const Baker *baker, const float *direct, uint32_t columns, const uint8_t *channel,
                                float *irradiance);
/* Radiosity as samples carry it at run time: direct light, and their albedo times the irradiance from the links, which is not
 * let below 0; times `scale` of the column (NULL: 1). direct: [leaf][column]; irradiance: [sample][column], may be `carried`;
 * carried: [leaf], rows of `carried_columns`. */
void chiaro_bake_carry(const Baker *baker, const float *direct, const float *irradiance, uint32_t columns,
                       const uint8_t *channel, const float *scale, float *carried, uint32_t carried_columns);

/* --- write.c --- */
/* A block: a header, whose magic and version are set, and what the slots of the arrays point to. */
ChiaroResult chiaro_bake_block(const ChiaroFileStart *header, size_t header_size, const ChiaroFileArray *arrays,
                               uint32_t count, ChiaroBlob *blob);

/* --- bake.c --- */
/* The power of two that serves as a number of rays: n or a little more. */
uint32_t chiaro_bake_ray_count(uint32_t n);
void chiaro_bake_bounds(Baker *baker);
void chiaro_bake_release(Baker *baker);
/* A table of training light, all zero. NULL: out of memory. */
float *chiaro_bake_table(size_t rows, size_t columns);
/* For chiaro_parallel_for: tells the host how far the current stage is. */
bool chiaro_bake_progress(float done, void *baker);

#endif
