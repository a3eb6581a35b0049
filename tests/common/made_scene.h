/* The scenes that the programs make, for tests. Included after cmocka.h. */
#ifndef CHIARO_TEST_MADE_SCENE_H
#define CHIARO_TEST_MADE_SCENE_H

#include "../../samples/common/scenes.h"

static inline TestScene make_scene(const char *name, SceneRequest request)
{
    TestScene made;
    const char *fault;
    if (!scenes_make(name, &request, &made, &fault))
        fail_msg("%s: %s", name, fault);
    assert_int_equal(chiaro_scene_check(&made.scene, NULL), CHIARO_OK);
    return made;
}

#endif
