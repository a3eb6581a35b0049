/* Chiaro: objects as primitives (article: "The world is a hierarchical BRDF", "The ideal size of a primitive is one
 * pixel", and neighbours as lights in "Neighbor lists"), and what they block.
 *
 * An object's surface is given as elements: small discs with an area, a normal and an albedo. A binary tree stands over
 * them. Each node is a primitive that can take the place of all its elements: how large it looks from any direction,
 * and what it reflects from any direction into any other. From far away the root is enough; coming closer, it opens.
 *
 * A node knows two forms and takes the one that is closer to its elements, which is measured when the tree is built:
 *
 *   - dot: one normal, the article's "dot product and a color", and a cone about it, which softens the edge where some
 *     elements face away. Exact where the node is flat, within a few percent up to an eighth of a sphere.
 *   - axes: six values, toward +x -x +y -y +z -z, for closed and round shapes. What differs between a direction and its
 *     opposite is a dot product, and exact. What is the same is weighed by the squared components of the direction, and
 *     partly by their magnitudes: the squares are exact for a sphere, the magnitudes for a box along the axes. The
 *     share of each is chosen so that the mean over all directions is exact, which for projected area is a quarter of
 *     the surface (Cauchy). Open shapes gain a little, where what would be negative is cut off.
 *
 * Elements do not hide each other: projected area and reflected light are sums over all that face the viewer, as for a
 * convex object. An object of many parts looks no larger than the sphere that holds it.
 *
 * Directions are unit vectors and point away from the object: toward the viewer, toward the light. Intensity is W/sr.
 * Memory is the host's: ask for the size, hand over a block. Nothing is allocated.
 */
#ifndef CHIARO_CHIARO_PRIMITIVES_H
#define CHIARO_CHIARO_PRIMITIVES_H

#include "chiaro.h"

#ifdef __cplusplus
extern "C" {
#endif

#define CHIARO_MAX_ELEMENTS (1u << 20)
#define CHIARO_MAX_BLOCKERS 16u

/** A piece of an object's surface. It is seen and lit from the side of its normal only. */
typedef struct ChiaroElement {
    float position[3];
    float area;      /**< m^2. Counts as a disc. */
    float normal[3]; /**< Unit. */
    float reserved0;
    float albedo[3]; /**< 0 .. 1. */
    float reserved1;
} ChiaroElement;

typedef enum ChiaroPrimitiveForm { CHIARO_PRIMITIVE_DOT, CHIARO_PRIMITIVE_AXES } ChiaroPrimitiveForm;

/** A node of the tree. Nodes stand in depth-first order: a node is followed by its first child's nodes, then by its
 * second child's. The first child of node n is n + 1, the second one is nodes[n + 1].next; a leaf has next == n + 1. */
typedef struct ChiaroPrimitive {
    float center[3];
    float radius;    /**< Of a sphere about the centre that holds all elements. */
    float normal[3]; /**< Mean normal, not normalised: its length tells how flat the node is. */
    float area;      /**< Of all elements. */
    float projected[6];    /**< Projected area toward +x -x +y -y +z -z. */
    float reflected[6][3]; /**< Intensity back toward an axis from irradiance 1, one direction, along the same axis. */
    float projected_blend; /**< Share of the magnitudes, in projected area. */
    float reflected_blend; /**< Share of the box's law, in reflected light. */
    float error;           /**< Of the form, relative rms over all directions: projected area or light, the worse. */
    uint32_t form;         /**< ChiaroPrimitiveForm. */
    uint32_t next;         /**< The node after this one and all that is below it. */
    uint32_t first, count; /**< Run of ChiaroPrimitives.elements. */
    uint32_t reserved;
} ChiaroPrimitive;

typedef struct ChiaroPrimitives {
    const ChiaroPrimitive *nodes; /**< The root is node 0. */
    const uint32_t *elements;     /**< Numbers of elements, in the order of the leaves. */
    uint32_t node_count;          /**< 2 * element_count - 1. */
    uint32_t element_count;
} ChiaroPrimitives;

/* ------------------------------------------------------------------------------------------------------------------
 * The tree
 */

/** Bytes that the tree of so many elements needs.
 * @return 0 where the number is not 1 .. CHIARO_MAX_ELEMENTS. @thread_safety any thread. @errors none. @lifetime
 * nothing is kept. */
CHIARO_API size_t chiaro_primitives_size(uint32_t element_count);

/** Builds the tree over an object's surface, by position and normal.
 * @param elements element_count of them. @param memory aligned to 16. @param size its bytes.
 * @param primitives receives views into `memory`.
 * @errors CHIARO_ERROR_ARGUMENT: number, memory, or an element that is not finite, without unit normal, or with an
 * albedo out of range.
 * @thread_safety any thread. @lifetime elements may go; the tree is valid as long as `memory`. */
CHIARO_API ChiaroResult chiaro_primitives_build(const ChiaroElement *elements, uint32_t element_count, void *memory,
                                                size_t size, ChiaroPrimitives *primitives);

/** Nodes that together are the object, none of which spans more than an angle. */
typedef struct ChiaroPrimitiveWalk {
    const ChiaroPrimitives *primitives;
    float point[3];
    float sine_squared;
    uint32_t next;
} ChiaroPrimitiveWalk;

/** Begins a walk over the nodes as a receiver sees them.
 * @param point where the receiver is, in the space of the elements. @param angle what a node may span, radians,
 * 0 .. pi: leaves alone may span more. @return the walk, for chiaro_primitive_walk_next().
 * @thread_safety any thread. @lifetime as long as the tree. @errors none. */
CHIARO_API ChiaroPrimitiveWalk chiaro_primitive_walk_begin(const ChiaroPrimitives *primitives, const float point[3],
                                                           float angle);

/** The next node of a walk. @return its number; CHIARO_NONE at the end. @thread_safety one thread a walk. @errors none.
 * @lifetime nothing is kept. */
CHIARO_API uint32_t chiaro_primitive_walk_next(ChiaroPrimitiveWalk *walk);

/* ------------------------------------------------------------------------------------------------------------------
 * What a node looks like
 */

/** Projected area of a node, m^2. @param direction toward the viewer. @thread_safety any thread. @errors none.
 * @lifetime nothing is kept. */
CHIARO_API float chiaro_primitive_projected_area(const ChiaroPrimitive *node, const float direction[3]);

/** Light from one direction that a node reflects into another.
 * @param toward_light, toward_viewer unit. @param irradiance on a surface that faces the light, three floats.
 * @param intensity receives three floats. @thread_safety any thread. @errors none. @lifetime nothing is kept. */
CHIARO_API void chiaro_primitive_reflect(const ChiaroPrimitive *node, const float toward_light[3],
                                         const float irradiance[3], const float toward_viewer[3], float intensity[3]);

/** What a node reflects of a lamp or a sun, without shadow. However near the lamp is, a node takes no more than the
 * lamp sends into the solid angle that it fills.
 * @param intensity receives three floats. @thread_safety any thread. @errors none. @lifetime nothing is kept. */
CHIARO_API void chiaro_primitive_light(const ChiaroPrimitive *node, const ChiaroLight *light,
                                       const float toward_viewer[3], float intensity[3]);

/** Sums what the elements give off, for every node: toward each axis, as six times three floats.
 * @param elements as they were given to chiaro_primitives_build(). @param radiosity three floats an element: emission,
 * and albedo times irradiance. @param axes receives 18 floats a node. @thread_safety any thread. @errors none.
 * @lifetime nothing is kept. */
CHIARO_API void chiaro_primitives_sum(const ChiaroPrimitives *primitives, const ChiaroElement *elements,
                                      const float *radiosity, float *axes);

/** What a node gives off toward a viewer, from the sums of chiaro_primitives_sum().
 * @param axes the node's 18 floats. @param intensity receives three floats. @thread_safety any thread. @errors none.
 * @lifetime nothing is kept. */
CHIARO_API void chiaro_primitive_radiate(const ChiaroPrimitive *node, const float axes[18],
                                         const float toward_viewer[3], float intensity[3]);

/* ------------------------------------------------------------------------------------------------------------------
 * Neighbours as lights
 */

/** The normal that a closed object is lit with (article: half angle between viewer and light).
 * @param normal receives the unit vector; toward_viewer where the light is right behind. @thread_safety any thread.
 * @errors none. @lifetime nothing is kept. */
CHIARO_API void chiaro_half_angle_normal(const float toward_light[3], const float toward_viewer[3], float normal[3]);

/** What a round object reflects of a lamp or a sun toward a place, by the half-angle normal. A point light of this
 * intensity in its centre takes its place.
 *
 * The article's plain product of the two cosines reflects twice the light that comes in. Raised to 5/3 and times 2/3 it
 * reflects exactly that, is right where light and viewer are on one side, and within 1.3 % of that value everywhere.
 * @param albedo three floats. @param viewer the place, outside of the object. @param intensity receives three floats.
 * @thread_safety any thread. @errors none. @lifetime nothing is kept. */
CHIARO_API void chiaro_neighbour_light(const float center[3], float radius, const float albedo[3],
                                       const ChiaroLight *light, const float viewer[3], float intensity[3]);

/* ------------------------------------------------------------------------------------------------------------------
 * What is in the way. All forms are shares of the cosine-weighted hemisphere over a receiver, 0 .. 1, cut off at its
 * horizon. Light that a node sends to a receiver is pi * (intensity / projected area) * form.
 */

/** Form factor of a sphere, exact. Receivers inside are treated as on its skin: no jump where things touch.
 * @param point, normal the receiver. @thread_safety any thread. @errors none. @lifetime nothing is kept. */
CHIARO_API float chiaro_sphere_form(const float point[3], const float normal[3], const float center[3], float radius);

/** Form factor of a disc, of either side; within 0.004, but for receivers that lie nearer to its rim than a seventh of
 * its radius. (As a polygon of 16 corners and equal area, by Lambert's formula; far away as one point.)
 * @thread_safety any thread. @errors none. @lifetime nothing is kept. */
CHIARO_API float chiaro_disc_form(const float point[3], const float normal[3], const float center[3],
                                  const float disc_normal[3], float radius);

/** Form factor of a node: of a plate where all of it faces the receiver, or of a sphere with its projected area.
 * @thread_safety any thread. @errors none. @lifetime nothing is kept. */
CHIARO_API float chiaro_primitive_form(const ChiaroPrimitive *node, const float point[3], const float normal[3]);

/** Something in the way, as a receiver sees it: a cap of directions. */
typedef struct ChiaroBlocker {
    float direction[3]; /**< Unit. */
    float angle;        /**< Half of what it spans, radians. */
    float form;
} ChiaroBlocker;

/** A sphere in the way. @thread_safety any thread. @errors none. @lifetime nothing is kept. */
CHIARO_API ChiaroBlocker chiaro_sphere_blocker(const float point[3], const float normal[3], const float center[3],
                                               float radius);

/** A node in the way. @thread_safety any thread. @errors none. @lifetime nothing is kept. */
CHIARO_API ChiaroBlocker chiaro_primitive_blocker(const ChiaroPrimitive *node, const float point[3],
                                                  const float normal[3]);

/** How much of the hemisphere several blockers take together. Never more than their sum nor less than the largest.
 *
 * Each one adds what the others, those of larger form first, leave of its cap: what lies apart is summed, what lies
 * behind another one is not counted again, and several that overlap the same cap count as independent of each other.
 * @param count at most CHIARO_MAX_BLOCKERS; the largest are taken where there are more. Their order does not matter.
 * @thread_safety any thread. @errors none. @lifetime nothing is kept. */
CHIARO_API float chiaro_blockers_combine(const ChiaroBlocker *blockers, uint32_t count);

#ifdef __cplusplus
}
#endif

#endif
